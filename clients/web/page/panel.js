// Everything around the picture: buttons, legend, plots, and what is wrong.

import { LARGEST_STRAIN, LEVELS, scale } from './deformation.js';

const element = (id) => document.getElementById(id);
// Of a plot [s].
const SPAN = 10;
const INKS = ['#ff7a66', '#6bb8ff', '#ffd166', '#8fe388'];

// Values over the last ten seconds, a curve for each key.
class Plot {
    constructor(canvas, unit, digits) {
        Object.assign(this, { canvas, unit, digits, curves: new Map(), drawn: 0 });
    }

    add(key, time, value) {
        if (!this.curves.has(key)) this.curves.set(key, []);
        const curve = this.curves.get(key);
        curve.push([time, value]);
        while (curve.length > 0 && curve[0][0] < time - SPAN) curve.shift();
    }

    draw(now) {
        if (now - this.drawn < 0.1 || this.canvas.offsetParent === null) return;
        this.drawn = now;
        const { canvas } = this, ratio = Math.min(devicePixelRatio || 1, 2);
        const [width, height] = [canvas.clientWidth, canvas.clientHeight];
        if (canvas.width !== Math.round(width * ratio)) [canvas.width, canvas.height] = [width * ratio, height * ratio].map(Math.round);
        const paint = canvas.getContext('2d');
        paint.setTransform(ratio, 0, 0, ratio, 0, 0);
        paint.clearRect(0, 0, width, height);
        const values = [...this.curves.values()].flatMap((curve) => curve.map(([, value]) => value));
        const top = roundNumber(Math.max(...values, 10 ** -this.digits));
        paint.font = '11px system-ui, sans-serif';
        paint.fillStyle = '#9fb0bf';
        paint.textBaseline = 'top';
        paint.fillText(`${top} ${this.unit}`, 2, 1);
        let i = 0;
        for (const curve of this.curves.values()) {
            paint.strokeStyle = INKS[i++ % INKS.length];
            paint.lineWidth = 1.5;
            paint.beginPath();
            for (const [time, value] of curve) {
                paint.lineTo(width * (1 - (now - time) / SPAN), height - 2 - ((height - 16) * value) / top);
            }
            paint.stroke();
        }
        const last = [...this.curves.values()].map((curve) => curve.at(-1)).filter((point) => point && now - point[0] < 2);
        const text = last.map(([, value]) => value.toFixed(this.digits)).join(' · ');
        paint.fillStyle = '#e7eef5';
        paint.textAlign = 'right';
        paint.fillText(text ? `${text} ${this.unit}` : '', width - 2, 1);
        paint.textAlign = 'left';
    }
}

// The next of 1, 2, 5 times a power of ten.
function roundNumber(value) {
    const power = 10 ** Math.floor(Math.log10(value));
    const times = [1, 2, 5, 10].find((times) => times * power >= value * 0.999999);
    return Number((times * power).toPrecision(2));
}

export class Panel {
    #faults = new Map();
    #forgetting = new Map();

    // `on`: what the buttons do: colouring(name), touch(on), tool(name), jaws(), depth(m), reset(), invite(), enter(mode).
    constructor(on) {
        this.force = new Plot(element('force'), 'N', 2);
        this.nodes = new Plot(element('nodes'), 'nodes', 0);
        for (const button of document.querySelectorAll('[data-colouring]')) {
            button.onclick = () => {
                this.#press('[data-colouring]', button);
                on.colouring(button.dataset.colouring);
            };
        }
        element('touch').onclick = () => on.touch(element('touch').getAttribute('aria-pressed') !== 'true');
        element('tool').onchange = ({ target }) => on.tool(target.value);
        element('jaws').onclick = () => on.jaws();
        element('depth').oninput = ({ target }) => on.depth(target.value / 1000);
        element('reset').onclick = () => on.reset();
        element('invite').onclick = () => on.invite(element('invited').value);
        element('enter-vr').onclick = () => on.enter('immersive-vr');
        element('enter-ar').onclick = () => on.enter('immersive-ar');
        element('more').onclick = () => document.body.classList.toggle('bare');
        element('address').onclick = () => navigator.clipboard?.writeText(element('address').textContent).catch(() => {});
    }

    #press(selector, pressed) {
        for (const button of document.querySelectorAll(selector)) button.setAttribute('aria-pressed', button === pressed);
    }

    // What is wrong, by where; null: nothing. The first that is known is shown.
    say(where, fault) {
        if (fault) this.#faults.set(where, fault);
        else this.#faults.delete(where);
        const worst = ['graphics', 'socket', 'link', 'tool', 'request'].map((known) => this.#faults.get(known)).find(Boolean);
        element('banner').textContent = worst ?? '';
        element('banner').hidden = !worst;
    }

    // Says it for some seconds.
    mention(where, fault) {
        this.say(where, fault);
        clearTimeout(this.#forgetting.get(where));
        this.#forgetting.set(where, setTimeout(() => this.say(where, null), 6000));
    }

    setRights(rights) {
        document.body.dataset.rights = rights;
        element('rights').textContent = rights === 'operator' ? 'you may touch' : 'you may watch';
    }

    setModes(modes) {
        element('enter-vr').hidden = !modes.includes('immersive-vr');
        element('enter-ar').hidden = !modes.includes('immersive-ar');
    }

    setSession({ body, tools }, levels) {
        element('name').textContent = body?.name ?? '';
        this.levels = levels;
        const list = element('tool'), chosen = list.value;
        list.replaceChildren(...tools.map(({ name, taken }) => {
            const option = document.createElement('option');
            [option.value, option.textContent] = [name, taken ? `${name} (held)` : name];
            return option;
        }));
        if (tools.some(({ name }) => name === chosen)) list.value = chosen;
        else list.value = (tools.find(({ taken }) => !taken) ?? tools[0])?.name ?? '';
    }

    get tool() {
        return element('tool').value;
    }

    setTouch(state) {
        element('touch').setAttribute('aria-pressed', state !== 'off');
        element('touch').textContent = state === 'asked' ? 'Taking…' : state === 'on' ? 'Let go' : 'Touch';
        document.body.dataset.touch = state;
    }

    // `state`: 'open', 'closed', or 'none' where the tool has no jaws.
    setJaws(state) {
        element('jaws').hidden = state === 'none';
        element('jaws').textContent = state === 'open' ? 'Close jaws' : 'Open jaws';
    }

    setDepth(depth) {
        element('depth').value = depth * 1000;
        element('depth-value').textContent = `${(depth * 1000).toFixed(0)} mm`;
    }

    setAddress(address, rights) {
        element('address').textContent = address;
        element('address').hidden = false;
        element('address').title = `lets one more browser ${rights === 'operator' ? 'touch' : 'watch'}, once; click to copy`;
    }

    setStatus({ tickRate, compute, nodes, elements, clients }) {
        const present = clients.length > 0 ? ` · ${clients.join(', ')}` : '';
        element('status').textContent =
            `${tickRate.toFixed(0)} Hz · ${nodes} nodes, ${elements} elements · a tick takes ${(compute?.p99 ?? 0).toFixed(0)} µs (p99)${present}`;
        this.nodes.add('nodes', performance.now() / 1000, nodes);
    }

    setRates(pictures, frames, answer) {
        const late = answer === null ? '' : ` · answer after ${answer.toFixed(0)} ms`;
        element('rates').textContent = `${pictures.toFixed(0)} pictures/s · ${frames.toFixed(0)} frames/s${late}`;
    }

    // What colours mean; `largest`: displacement at the end of its scale [m].
    setLegend(colouring, largest) {
        const legend = element('legend');
        legend.hidden = colouring === 'material';
        legend.replaceChildren();
        const add = (tag, text, colour) => {
            const part = document.createElement(tag);
            part.textContent = text;
            if (colour) part.style.background = `rgb(${colour.map(Math.round).join(' ')})`;
            legend.append(part);
        };
        if (colouring === 'level') {
            add('span', 'level');
            LEVELS.slice(0, this.levels ?? 1).forEach((colour, level) => add('b', level, colour));
        } else if (colouring !== 'material') {
            const [title, end] = colouring === 'strain' ? ['strain', `${100 * LARGEST_STRAIN} %`] : ['shift', `${(1000 * largest).toFixed(0)} mm`];
            add('span', `${title} 0`);
            for (let i = 0; i < 12; i++) add('b', '', scale(i / 11));
            add('span', end);
        }
    }

    draw(now) {
        this.force.draw(now / 1000);
        this.nodes.draw(now / 1000);
    }
}
