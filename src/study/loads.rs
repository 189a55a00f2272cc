//! How much each level of a body gives way under smooth loads, and half of one level beside half of another: by the core's own
//! forces, in small strain, against the finest level and, in uniform stress, the closed form.

use super::Progress;
use super::plot::{self, shapes, table};
use super::trial::Trial;
use palpate_body::geometry::primitives::liver_surface;
use palpate_body::prepare::inclusions::Inclusion;
use palpate_body::prepare::region::Reach;
use palpate_body::prepare::{Elements, Recipe, Region, Shape, prepare};
use palpate_core::geometry::primitives::box_surface;
use palpate_core::ids::{Node, Slot, Vertex};
use palpate_core::math::{Bounds, Mat3, Real, Vec3};
use palpate_core::model::element_kernel::Simd;
use palpate_core::model::{ActiveMesh, Body, Fibres, Material, State};
use palpate_core::simulation::Inputs;
use palpate_core::stepping::step;
use rayon::prelude::*;
use std::io::{Error, Result};
use std::path::Path;
use std::sync::Arc;

/// Young's modulus of all of them [Pa], to which all answers are in proportion; a stiff layer has ten times as much.
pub const YOUNGS_MODULUS: Real = 1e4;

/// Of this Poisson's ratio and of 1000 kg/m³.
pub fn material(nu: Real) -> Material {
    Material::from_young(YOUNGS_MODULUS, nu, 1000.0)
}

/// A body to load.
#[derive(Clone, Debug)]
pub struct Specimen {
    /// What it is made from.
    pub shape: Shape,
    /// What it is of.
    pub material: Material,
    /// Where that is ten times as stiff.
    pub stiff: Option<Reach>,
    /// Held in there, or free [m].
    pub held: Option<Bounds>,
    /// See [`Recipe::elements`].
    pub elements: Elements,
    /// See [`Recipe::damping_ratio`].
    pub damping_ratio: Real,
}

impl Specimen {
    /// A box from the origin to `size` [m], held at x = 0, of smoothed elements.
    pub fn of_box(shape: Shape, size: Vec3, material: Material) -> Self {
        let near = 1e-6;
        let face = Bounds::new(Vec3::repeat(-near), Vec3::new(near, size.y + near, size.z));
        Self { shape, material, stiff: None, held: Some(face), elements: Elements::Smoothed, damping_ratio: 0.0 }
    }

    /// As a body.
    ///
    /// # Errors
    /// When it cannot be prepared.
    pub fn body(&self) -> Result<Body> {
        let stiff = |place: &Reach| Inclusion {
            place: (*place).into(),
            youngs_modulus: 10.0 * YOUNGS_MODULUS,
            poisson_ratio: self.material.poisson_ratio(),
            density: 1000.0,
            neo_hookean: 0.0,
            fibres: Fibres::NONE,
        };
        let exact = matches!(self.shape, Shape::Meshes { .. });
        let recipe = Recipe {
            name: "specimen".into(),
            shape: self.shape.clone(),
            material: self.material,
            inclusions: self.stiff.iter().map(stiff).collect(),
            holds: self.held.iter().map(|bounds| Region { bounds: *bounds, stiffness: None, exact }).collect(),
            elements: self.elements,
            damping_ratio: self.damping_ratio,
        };
        prepare(&recipe, &mut |_, _, _| {}).map_err(Error::other)
    }
}

/// Covers of a box of `size` [m] at these spacings [m].
pub fn cover(size: Vec3, spacings: &[Real]) -> Shape {
    // As dense as surfaces are shown: between supports farther apart, the finer a level the more it would give way.
    let cells = size / (0.4 * spacings[spacings.len() - 1]);
    Shape::closed(box_surface(size, [cells.x as u32, cells.y as u32, cells.z as u32]), spacings.to_vec())
}

/// Forces on the active nodes [N], by slot: `acceleration` of the rest place times the masses.
fn on_masses(body: &Body, mesh: &ActiveMesh, acceleration: &dyn Fn(&Vec3) -> Vec3) -> Vec<Vec3> {
    let mut load = vec![Vec3::zeros(); mesh.motion.mass.len()];
    for &slot in mesh.active() {
        load[slot.index()] = acceleration(&body.rest(mesh.node(slot))) * mesh.motion.mass[slot.index()];
    }
    load
}

/// The same of `traction` (place, area vector) [N] on the displayed surface.
fn on_surface(body: &Body, mesh: &ActiveMesh, traction: &dyn Fn(&Vec3, &Vec3) -> Vec3) -> Vec<Vec3> {
    let mut load = vec![Vec3::zeros(); mesh.motion.mass.len()];
    for triangle in &body.surface().triangles {
        let [a, b, c] = triangle.map(|v| body.surface().vertices[v as usize]);
        let area = (b - a).cross(&(c - a)) * 0.5;
        for v in triangle {
            let force = traction(&body.surface().vertices[*v as usize], &area) / 3.0;
            let at = mesh.embedding(Vertex(*v));
            at.slots.iter().zip(at.weights).for_each(|(slot, w)| load[slot.index()] += force * w);
        }
    }
    load
}

/// Work [J] of the balanced `load` (by slot) on the displacements that it brings about: conjugate gradients on differences of
/// the core's forces.
///
/// # Errors
/// When these do not come to rest.
fn work(body: &Body, mesh: &mut ActiveMesh, load: &[Vec3]) -> Result<Real> {
    /// Largest displacement in a difference of forces [m]: a hundred times more strains elements visibly, a thousand times less rounds.
    const SMALL: Real = 1e-7;
    // What acts on interface nodes acts on their masters.
    mesh.motion.force.iter_mut().zip(load).for_each(|(f, load)| *f = [load.x, load.y, load.z, 0.0]);
    mesh.hand_back_all();
    let handed: Vec<Vec3> = mesh.motion.force.iter().map(|f| Vec3::from_column_slice(&f[..3])).collect();
    let slots: Vec<Slot> = mesh.active().to_vec();
    let rest: Vec<Vec3> = slots.iter().map(|slot| body.rest(mesh.node(*slot))).collect();
    let fixed: Vec<bool> = slots.iter().map(|slot| body.is_fixed(mesh.node(*slot))).collect();
    let mut resist = |u: &[Vec3]| -> Vec<Vec3> {
        let h = SMALL / u.iter().map(|u| u.norm()).fold(1e-300, Real::max);
        let mut forces = |sign: Real| -> Vec<Vec3> {
            mesh.motion.force.fill([0.0; 4]);
            for (i, slot) in slots.iter().enumerate() {
                let x = rest[i] + u[i] * (h * sign);
                mesh.motion.position[slot.index()] = [x.x, x.y, x.z, 0.0];
            }
            step::add_elastic_forces(Simd::best(), mesh);
            let force = |slot: &Slot| Vec3::from_column_slice(&mesh.motion.force[slot.index()][..3]);
            slots.iter().map(force).collect()
        };
        let (ahead, behind) = (forces(1.0), forces(-1.0));
        let slope = |i: usize| if fixed[i] { Vec3::zeros() } else { (behind[i] - ahead[i]) / (2.0 * h) };
        (0..slots.len()).map(slope).collect()
    };
    let dot = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<Real>();
    let load: Vec<Vec3> =
        slots.iter().zip(&fixed).map(|(s, f)| if *f { Vec3::zeros() } else { handed[s.index()] }).collect();
    let (mut u, mut r, mut p) = (vec![Vec3::zeros(); slots.len()], load.clone(), load.clone());
    let (mut square, enough) = (dot(&r, &r), 1e-7 * dot(&load, &load));
    for _ in 0..20_000 {
        if square < enough {
            return Ok(dot(&u, &load));
        }
        let q = resist(&p);
        let along = square / dot(&p, &q);
        for i in 0..u.len() {
            u[i] += p[i] * along;
            r[i] -= q[i] * along;
        }
        let next = dot(&r, &r);
        for (p, r) in p.iter_mut().zip(&r) {
            *p = r + *p * (next / square);
        }
        square = next;
    }
    Err(Error::other("a level does not come to rest under its load"))
}

type Load<'a> = (&'a str, Box<dyn Fn(&Body, &ActiveMesh) -> Vec<Vec3> + Sync>);

/// Own weight in three directions; the far end pulled along, aside and turned, where it is flat; a press of 30 mm on the top.
fn loads(bounds: &Bounds, is_flat: bool) -> Vec<Load<'static>> {
    let (low, high) = (bounds.low, bounds.high);
    let middle = (low + high) / 2.0;
    let mut all: Vec<Load> = vec![];
    for (axis, name) in [(0, "own weight along x"), (1, "along y"), (2, "along z")] {
        all.push((name, Box::new(move |b, m| on_masses(b, m, &|_| Vec3::ith(axis, 1.0)))));
    }
    let mut at_end = |name, direction: fn(Vec3) -> Vec3| {
        let near = high.x - 0.001 * (high.x - low.x);
        let traction = move |x: &Vec3, area: &Vec3| {
            if x.x > near { direction(x - middle) * area.x.max(0.0) } else { Vec3::zeros() }
        };
        all.push((name, Box::new(move |b: &Body, m: &ActiveMesh| on_surface(b, m, &traction)) as _));
    };
    if is_flat {
        at_end("end pulled", |_| Vec3::x());
        at_end("end aside", |_| Vec3::y());
        at_end("end bent", |x| Vec3::x() * x.z);
        at_end("end twisted", |x| Vec3::x().cross(&x));
    } else {
        let spin = move |x: &Vec3| Vec3::x().cross(&(x - middle)) * ((x.x - low.x) / (high.x - low.x));
        all.push(("twisted about x", Box::new(move |b, m| on_masses(b, m, &spin))));
    }
    // A box has its top where its bounds do; of another body it is where the middle of its height is passed upward.
    let press = move |x: &Vec3, area: &Vec3| {
        let away = x - middle;
        let inside = away.z > 0.0 && away.x.abs() < 0.0151 && away.y.abs() < 0.0151;
        if inside { -Vec3::z() * area.z.max(0.0) } else { Vec3::zeros() }
    };
    all.push(("press", Box::new(move |b, m| on_surface(b, m, &press))));
    all
}

/// Half of `body` in the nodes of the level before the finest, the other half, of larger x, in their children.
///
/// # Errors
/// When these do not cover the body once.
pub fn halves(body: &Body) -> Result<State> {
    let Bounds { low, high } = body.surface().bounds();
    let middle = (low.x + high.x) / 2.0;
    let far = |n: &Node| body.rest(*n).x > middle && !body.children(*n).is_empty();
    let (split, kept): (Vec<Node>, Vec<Node>) = body.nodes_of(body.finest() - 1).partition(far);
    let nodes = kept.into_iter().chain(split.iter().flat_map(|n| body.children(*n).iter().copied()));
    State::at_rest_on(body, nodes.collect()).ok_or_else(|| Error::other("the halves do not cover the body once"))
}

/// Every level of `body` but the finest, and its [`halves`].
fn sets(body: &Body) -> Result<Vec<State>> {
    let mut all: Vec<State> = (0..body.finest()).map(|r| State::at_rest(body, r)).collect();
    all.push(halves(body)?);
    Ok(all)
}

/// How much more each level but the finest, and the [`halves`], give way than the finest under each load: its work over the finest's, less
/// one.
///
/// # Errors
/// When a level does not come to rest.
pub fn compared(body: &Body) -> Result<Vec<(&'static str, Vec<Real>)>> {
    let bounds = body.surface().bounds();
    let is_flat = body.surface().vertices.iter().filter(|v| v.x > bounds.high.x - 1e-9).count() > 3;
    let of = |(what, load): &Load<'static>| {
        let work = |state: &State| {
            let mut mesh = ActiveMesh::new(body, state, usize::MAX).map_err(Error::other)?;
            let load = load(body, &mesh);
            work(body, &mut mesh, &load)
        };
        let finest = work(&State::at_rest(body, body.finest()))?;
        let off = sets(body)?.iter().map(|state| Ok(work(state)? / finest - 1.0)).collect::<Result<_>>()?;
        Ok((*what, off))
    };
    loads(&bounds, is_flat).par_iter().map(of).collect()
}

/// Twice the strain energy density [J/m³] of `body`, free and of the active nodes of `state`, under this uniform stress [Pa].
///
/// # Errors
/// When it does not come to rest.
pub fn compliance(body: &Body, state: &State, stress: Mat3) -> Result<Real> {
    let mut mesh = ActiveMesh::new(body, state, usize::MAX).map_err(Error::other)?;
    let load = on_surface(body, &mesh, &|_, area| stress * area);
    Ok(work(body, &mut mesh, &load)? / body.parts().shape.volume)
}

/// Young's modulus in these directions and twice the shear modulus, found under uniform stress in free `body` of `material` and the
/// active nodes of `state`, over the closed form, less one.
///
/// # Errors
/// When it does not come to rest.
pub fn off_closed_form(body: &Body, state: &State, material: &Material) -> Result<[Real; 4]> {
    let off = |stress: Mat3, expected: Real| Ok::<_, Error>(compliance(body, state, stress)? / expected - 1.0);
    let along = |axis: usize| off(Mat3::from_diagonal(&Vec3::ith(axis, 1.0)), 1.0 / material.youngs_modulus());
    let mut shear = Mat3::zeros();
    (shear[(0, 1)], shear[(1, 0)]) = (1.0, 1.0);
    Ok([along(0)?, along(1)?, along(2)?, off(shear, 1.0 / material.mu)?])
}

const KINDS: [(Elements, &str); 2] = [(Elements::Tetrahedra, "tetrahedra"), (Elements::Smoothed, "smoothed")];

/// What is loaded: name, specimen, and how many elements of each level are across where it is thinnest.
fn specimens() -> Vec<(String, Specimen)> {
    let mut all = Vec::new();
    let mut add = |name: &str, size: Vec3, spacings: &[Real], nu: Real, stiff: Option<Reach>| {
        let across: Vec<String> = spacings.iter().map(|a| format!("{:.1}", size.min() / a)).collect();
        let name = format!("{name}, ν = {nu}, {} elements across", across.join(", "));
        let specimen = Specimen::of_box(cover(size, spacings), size, material(nu));
        all.push((name, Specimen { stiff, ..specimen }));
    };
    for nu in [0.3, 0.45, 0.49] {
        add("cube", Vec3::repeat(0.1), &[0.0333, 0.02, 0.0125], nu, None);
    }
    add("bar 2:1", Vec3::new(0.1, 0.05, 0.05), &[0.022, 0.014, 0.0085], 0.45, None);
    add("bar 5:1", BAR, &BAR_SPACINGS, 0.45, None);
    add("bar 10:1", Vec3::new(0.3, 0.03, 0.03), &[0.0135, 0.0085], 0.45, None);
    add("plate 5:5:1", Vec3::new(0.1, 0.1, 0.02), &[0.015, 0.009, 0.006], 0.45, None);
    let across = Bounds::new(Vec3::new(0.067, -1.0, -1.0), Vec3::new(0.133, 1.0, 1.0));
    add("bar 5:1 with a stiff third across", BAR, &BAR_SPACINGS, 0.3, Some(Reach::Box(across)));
    let along = Bounds::new(Vec3::repeat(-1.0), Vec3::new(1.0, 1.0, 0.013));
    add("bar 5:1 with a stiff layer of 13 mm along", BAR, &BAR_SPACINGS, 0.3, Some(Reach::Box(along)));
    let (surface, spacings) = (liver_surface(0.006), [0.028, 0.018, 0.011]);
    let Bounds { low, high } = surface.bounds();
    let liver = Specimen {
        held: Some(Bounds::new(low, Vec3::new(high.x, high.y, low.z + 0.3 * (high.z - low.z)))),
        stiff: Some(Reach::Ball(Vec3::new(-0.02, 0.0, 0.08), 0.01)),
        ..Specimen::of_box(Shape::closed(surface, spacings.to_vec()), Vec3::zeros(), material(0.45))
    };
    all.push(("liver with a stiff ball of 20 mm, ν = 0.45, levels of 28, 18 and 11 mm".into(), liver));
    all
}

const BAR: Vec3 = Vec3::new(0.2, 0.04, 0.04);
const BAR_SPACINGS: [Real; 3] = [0.03, 0.018, 0.01];

fn percents(off: &[Real]) -> String {
    off.iter().map(|off| format!("{:+.1}", 100.0 * off)).collect::<Vec<_>>().join(", ")
}

/// Loads on every level of many bodies, of tetrahedra alone and of smoothed elements.
///
/// # Errors
/// When a body cannot be prepared or does not come to rest.
pub fn agreement(out: &Path, progress: Progress) -> Result<String> {
    let mut rows = Vec::new();
    for (name, specimen) in specimens() {
        progress(&name);
        let of = |(elements, _): (Elements, &str)| {
            let body = Specimen { elements, ..specimen.clone() }.body()?;
            let alphas: Vec<String> = body.levels().iter().map(|level| format!("{:.2}", level.stabilisation)).collect();
            Ok::<_, Error>((alphas.join(", "), compared(&body)?))
        };
        let [(_, tetrahedra), (alphas, smoothed)] = [of(KINDS[0])?, of(KINDS[1])?];
        for (i, ((load, plain), (_, off))) in tetrahedra.iter().zip(&smoothed).enumerate() {
            let first = if i == 0 { format!("{name}; α {alphas}") } else { String::new() };
            rows.push(vec![first, (*load).to_owned(), percents(plain), percents(off)]);
        }
    }
    let answers = table(out, "agreement", &["body", "load", KINDS[0].1, KINDS[1].1], &rows)?;
    progress("uniform stress");
    let mut rows = Vec::new();
    for nu in [0.3, 0.45, 0.49] {
        for (name, size, spacings) in [
            ("block", Vec3::new(0.1, 0.08, 0.06), [0.03, 0.018, 0.011]),
            ("bar 5:1", BAR, BAR_SPACINGS),
            ("plate 5:5:1", Vec3::new(0.1, 0.1, 0.02), [0.015, 0.009, 0.006]),
        ] {
            let mut row = vec![format!("{name}, ν = {nu}")];
            for (elements, _) in KINDS {
                let specimen = Specimen::of_box(cover(size, &spacings), size, material(nu));
                let body = Specimen { held: None, elements, ..specimen }.body()?;
                let mut states: Vec<State> = (0..=body.finest()).map(|r| State::at_rest(&body, r)).collect();
                states.push(halves(&body)?);
                let worst = |state: &State| {
                    let off = off_closed_form(&body, state, &material(nu))?;
                    Ok(off.into_iter().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or_default())
                };
                row.push(percents(&states.par_iter().map(worst).collect::<Result<Vec<Real>>>()?));
            }
            rows.push(row);
        }
    }
    let uniform = table(out, "uniform_stress", &["free body", KINDS[0].1, KINDS[1].1], &rows)?;
    progress("bars of each level at rest under their weight");
    bars(out)?;
    Ok(format!(
        "How much more each level but the finest gives way under a load, and last a body half of whose nodes are of the level before the \
         finest, half of the finest: work over the finest level's, less one [%], in small strain. Held at one end, the liver in a bed. \
         Tetrahedra are linear ones alone; smoothed elements are the default.\n\n{answers}\nFree bodies in uniform stress along three axes \
         and in shear, the largest of the four off the closed form [%], on every level and a mixed set:\n\n{uniform}\n\
         ![a bar on each of its levels, pulled along itself and bent by its weight](bars.png)\n"
    ))
}

/// A bar on each of its levels at rest under its weight, as it is shown.
fn bars(out: &Path) -> Result<()> {
    let cases = [
        (Elements::Smoothed, Vec3::new(8.0, 0.0, 0.0), "pulled along itself"),
        (Elements::Smoothed, Vec3::new(0.0, 0.0, -0.5), "bent"),
        (Elements::Tetrahedra, Vec3::new(0.0, 0.0, -0.5), "bent, tetrahedra alone"),
    ];
    let mut drawn = Vec::new();
    for (elements, gravity, how) in cases {
        let specimen = Specimen::of_box(cover(BAR, &BAR_SPACINGS), BAR, material(0.45));
        let body = Arc::new(Specimen { elements, ..specimen }.body()?);
        let rested = |r: usize| {
            let mut bar = Trial::hanging(gravity).on_level(&body, r)?;
            for _ in 0..4000 {
                bar.advance(&Inputs::default());
                bar.mesh_mut().change_motion(|_, _, v| *v *= 0.98);
            }
            let mut vertices = vec![Vec3::zeros(); body.surface().vertices.len()];
            bar.mesh().skin(&mut vertices);
            let low = vertices.iter().map(|x| x.z).fold(0.0, Real::min);
            let far = vertices.iter().map(|x| x.x).fold(0.0, Real::max);
            let moved = if gravity.x > 0.0 { far - BAR.x } else { -low };
            let title = format!("{:.0} mm, {how}: by {:.1} mm", 1e3 * BAR_SPACINGS[r], 1e3 * moved);
            Ok(plot::Shape { title, vertices, triangles: body.surface().triangles.clone() })
        };
        drawn.extend((0..BAR_SPACINGS.len()).into_par_iter().map(rested).collect::<Result<Vec<_>>>()?);
    }
    let title = "A bar of 200 mm on each of its levels, at rest under its weight";
    shapes(out, "bars", title, &drawn, BAR_SPACINGS.len(), BAR)
}
