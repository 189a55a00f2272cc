//! How the body as it moves is saved, hashed and restored: all that is not saved follows from it, bit for bit.

use super::residual::NO_RESIDUAL;
use super::{ActiveMesh, constants, padded, vec3};
use crate::ids::{Element, Node, Slot};
use crate::math::Vec3;
use crate::model::active_set::ActiveSet;
use crate::model::body::Body;
use crate::model::element::{History, StrainLimit};
use crate::model::element_pool::CLASSES;
use crate::model::state::State;
use crate::model::step_class;
use crate::visited::Visited;

impl ActiveMesh {
    /// Takes over `state`, from which a mesh of this body has been made before; allocates nothing. Everything that is not
    /// part of it follows from it, bit for bit.
    pub fn restore(&mut self, body: &Body, state: &State) {
        let covers = self.set.assign(body, &state.nodes);
        debug_assert!(covers, "a state is checked when a mesh is first made from it");
        self.pool.clear();
        self.stars.clear();
        self.slot.fill(Slot::NONE);
        self.active_vertices.fill(0);
        self.node.fill(Node::NONE);
        self.own_mass.fill(0);
        self.gathered_mass.fill(0);
        self.handed_mass.fill(0);
        self.motion.mass.fill(0.0);
        self.motion.inverse_mass.fill(0.0);
        self.motion.force.fill([0.0; 4]);
        self.motion.residual.fill(NO_RESIDUAL);
        self.active.clear();
        self.interface.clear();
        self.free.clear();
        self.free.extend((0..self.node.len()).rev().map(Slot::at));
        self.row_entries = 0;
        self.alike_is_known = false;
        for (((&n, x), v), residual) in
            state.nodes.iter().zip(&state.position).zip(&state.velocity).zip(&state.residual)
        {
            let slot = self.take_slot(body, n);
            self.enlist(slot, true);
            self.motion.residual[slot.index()] = residual.map(padded);
            self.motion.position[slot.index()] = padded(*x);
            self.motion.velocity[slot.index()] = padded(*v);
        }
        for &n in &state.interface {
            let slot = self.take_slot(body, n);
            self.enlist(slot, false);
        }
        let mut next = 0;
        for (class, ids) in state.classes.iter().enumerate() {
            for &e in ids {
                let nodes = body.element(e);
                let k = nodes.iter().filter(|n| self.set.is_active(**n)).count() as u8;
                self.active_vertices[e.index()] = k;
                let constants = constants(body, self.material_of(body, e), e, k);
                let history = state.history.get(next).unwrap_or(&History::REST);
                self.pool.insert(e, class, &nodes.map(|n| self.slot[n.index()]), &constants, history);
                self.weigh(body, e, i64::from(k));
                self.omega_squared[e.index()] = step_class::omega_squared(body, self.material_of(body, e), e);
                next += 1;
            }
        }
        let mut histories = state.star_history.iter();
        for (class, nodes) in state.stars.iter().enumerate() {
            for &n in nodes {
                self.note_star(body, n);
                self.note_stabilisation(body, n);
                let history = histories.next().unwrap_or(&History::REST);
                self.star_omega_squared[n.index()] = self.omega_squared_of_star(body, n);
                let constants = self.star_constants(body, n);
                self.stars.insert(n, class, &self.work.star, &constants, history);
            }
        }
        for i in 0..self.interface.len() {
            let slot = self.interface[i];
            self.make_row(body, slot);
        }
        self.normalise(body);
        self.place_interface();
        if state.history.is_empty() {
            for &e in state.classes.iter().flatten() {
                let constants = constants(body, self.material_of(body, e), e, self.active_vertices[e.index()]);
                let (strain, det) = self.strain(&constants, &body.element(e).map(|n| self.slot[n.index()]));
                self.pool.set_history(e, &History { strain, det, ..History::REST });
            }
            for &n in state.stars.iter().flatten() {
                self.note_star(body, n);
                let (strain, det) = self.strain(&self.star_constants(body, n), &self.work.star);
                self.stars.set_history(n, &History { strain, det, ..History::REST });
            }
        }
        self.geomorph.copy_from_slice(&state.geomorph);
        self.morphing.clear();
        self.morphing.extend(body.vertices().filter(|v| self.geomorph[v.index()] != [0.0; 4]));
        self.extrapolated.clear();
        self.lever = 1.0;
        self.residuals = state.residual.iter().flatten().any(|e| *e != Vec3::zeros());
        for v in body.vertices() {
            self.attach(body, v);
        }
        self.fold_all_supports(body);
        self.weigh_supports();
        let mut limits = state.strain_limit.iter();
        for (class, ids) in state.classes.iter().enumerate() {
            for &e in ids {
                match limits.next() {
                    Some(limit) => self.pool.set_strain_limit(e, *limit),
                    None => self.limit_strain(body, e, class),
                }
            }
        }
        let mut limits = state.star_strain_limit.iter();
        for (class, nodes) in state.stars.iter().enumerate() {
            for &n in nodes {
                match limits.next() {
                    Some(limit) => self.stars.set_strain_limit(n, *limit),
                    None => self.limit_strain_of_star(body, n, class),
                }
            }
        }
        self.revision.iter_mut().for_each(|r| *r = r.wrapping_add(1));
    }

    /// Refuses a state that is not one of this mesh.
    pub(super) fn check(&self, body: &Body, set: &ActiveSet, state: &State) -> Result<(), String> {
        let nodes = state.nodes.len();
        let moving = [state.position.len(), state.velocity.len(), state.residual.len()];
        if moving.iter().any(|len| *len != nodes) || state.geomorph.len() != self.geomorph.len() {
            return Err(format!("the state's arrays do not fit {nodes} active nodes and the body's surface"));
        }
        let elements = state.classes.iter().map(Vec::len).sum::<usize>();
        let fits = |len: usize| len == 0 || len == elements;
        if state.classes.len() != CLASSES || !fits(state.strain_limit.len()) || !fits(state.history.len()) {
            return Err("the state's elements do not fit its step classes".into());
        }
        let mut stars: Vec<Node> = state.stars.iter().flatten().copied().collect();
        let fits = |len: usize| len == 0 || len == stars.len();
        let classes = state.stars.len() == CLASSES;
        if !(classes && fits(state.star_strain_limit.len()) && fits(state.star_history.len())) {
            return Err("the state's stars do not fit their step classes".into());
        }
        let mut around = if body.stars().is_empty() { Vec::new() } else { state.nodes.clone() };
        stars.sort_unstable();
        around.sort_unstable();
        if stars != around {
            return Err("the state's stars are not those of its active nodes".into());
        }
        if elements > self.pool.capacity() || nodes + state.interface.len() > self.node.len() {
            return Err(format!("{elements} elements: this session has room for {}", self.pool.capacity()));
        }
        let in_use = |e: Element| body.element(e).iter().any(|n| set.is_active(*n));
        let count = body.element_count();
        let mut seen = Visited::new(count);
        for &e in state.classes.iter().flatten() {
            if e.index() >= count || !seen.visit(e.index()) || !in_use(e) {
                return Err(format!("element {e} of the state is not one that its active nodes need, once"));
            }
        }
        let needed = body.elements().filter(|e| in_use(*e)).count();
        let mut interface: Vec<Node> = state.interface.clone();
        interface.sort_unstable();
        let mut expected: Vec<Node> = body
            .elements()
            .filter(|e| in_use(*e))
            .flat_map(|e| body.element(e))
            .filter(|n| !set.is_active(*n))
            .collect();
        expected.sort_unstable();
        expected.dedup();
        if needed != elements || interface != expected {
            return Err("the state's elements and interface nodes are not those of its active nodes".into());
        }
        Ok(())
    }

    /// Writes the state into `state`, which was made for this body; allocates nothing once `state` has the room.
    pub fn save_into(&self, state: &mut State) {
        self.save_shape_into(state);
        for e in state.classes.iter().flatten() {
            state.history.push(self.pool.history(*e).unwrap_or(History::REST));
            state.strain_limit.push(self.pool.strain_limit(*e).unwrap_or(StrainLimit::NONE));
        }
        for n in state.stars.iter().flatten() {
            state.star_history.push(self.stars.history(*n).unwrap_or(History::REST));
            state.star_strain_limit.push(self.stars.strain_limit(*n).unwrap_or(StrainLimit::NONE));
        }
    }

    /// As [`ActiveMesh::save_into`], without what the elements remember, which is most of it.
    pub fn save_shape_into(&self, state: &mut State) {
        state.nodes.clear();
        state.position.clear();
        state.velocity.clear();
        state.residual.clear();
        for &slot in &self.active {
            state.nodes.push(self.node[slot.index()]);
            state.position.push(vec3(&self.motion.position[slot.index()]));
            state.velocity.push(vec3(&self.motion.velocity[slot.index()]));
            state.residual.push(self.motion.residual[slot.index()].map(|e| vec3(&e)));
        }
        state.interface.clear();
        state.interface.extend(self.interface.iter().map(|s| self.node[s.index()]));
        state.history.clear();
        state.strain_limit.clear();
        for (class, ids) in state.classes.iter_mut().enumerate() {
            ids.clear();
            ids.extend(self.pool.ids(class));
        }
        state.star_history.clear();
        state.star_strain_limit.clear();
        for (class, nodes) in state.stars.iter_mut().enumerate() {
            nodes.clear();
            nodes.extend(self.stars.ids(class));
        }
        state.geomorph.clear();
        state.geomorph.extend_from_slice(&self.geomorph);
    }

    /// Feeds every bit of what [`ActiveMesh::save_into`] saves to `hash`.
    pub fn hash_into(&self, hash: &mut xxhash_rust::xxh3::Xxh3) {
        hash.update(&(self.active.len() as u32).to_le_bytes());
        for &slot in &self.active {
            let s = slot.index();
            hash.update(&self.node[s].0.to_le_bytes());
            hash.update(bytemuck::cast_slice(&self.motion.position[s][..3]));
            hash.update(bytemuck::cast_slice(&self.motion.velocity[s][..3]));
            let residual = &self.motion.residual[s];
            let decays = *residual != NO_RESIDUAL;
            hash.update(&[u8::from(decays)]);
            if decays {
                hash.update(bytemuck::cast_slice(residual.as_flattened()));
            }
        }
        hash.update(&(self.interface.len() as u32).to_le_bytes());
        self.interface.iter().for_each(|s| hash.update(&self.node[s.index()].0.to_le_bytes()));
        (0..CLASSES).for_each(|class| self.pool.hash_into(class, hash));
        if !self.stars.is_empty() {
            (0..CLASSES).for_each(|class| self.stars.hash_into(class, hash));
        }
        for (v, geomorph) in self.geomorph.iter().enumerate().filter(|(_, geomorph)| **geomorph != [0.0; 4]) {
            hash.update(&(v as u32).to_le_bytes());
            hash.update(bytemuck::cast_slice(geomorph));
        }
    }
}
