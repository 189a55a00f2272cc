//! Levels in one body: the printed coupling by forces, and the one by energy, on the same active sets.

use super::laws::{Law, Spring};
use super::levels::Levels;
use super::rows::{Row, RowKind, rows};
use palpate_core::math::{Real, Vec3};

/// How regions of different levels act on each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coupling {
    /// As printed [DDCB01 2.3]: an active node gathers the full forces of its own level's elements, and interface nodes
    /// only follow. No energy belongs to it, and action is not reaction.
    Force,
    /// One energy `U = Σ w_t vol_t W(F_t)` with `w_t` a quarter per active vertex; what pulls at an interface node
    /// is handed back to its masters through its row.
    Energy,
}

impl Coupling {
    /// Words for a legend.
    pub fn name(self) -> &'static str {
        match self {
            Self::Force => "by forces (printed)",
            Self::Energy => "by energy",
        }
    }
}

/// A body with one set of active nodes.
#[derive(Clone, Debug)]
pub struct Mixed<'a> {
    /// The levels.
    pub levels: &'a Levels,
    /// Law of the elements.
    pub law: Law,
    /// How its regions act on each other.
    pub coupling: Coupling,
    /// Which nodes integrate their own motion (n_nodes); fixed ones are never among them.
    pub moving: Vec<bool>,
    /// Which nodes are active (n_nodes), fixed ones included.
    pub active: Vec<bool>,
    /// Interface nodes with their rows.
    pub interface: Vec<(usize, Row)>,
    /// Elements that touch an active node, with their weight `w_t`.
    pub weighted: Vec<(usize, Real)>,
    /// Springs that end at an active node, with the active part of their ends; used under [`Law::MassSpring`] alone.
    weighted_springs: Vec<(usize, Real)>,
    /// Mass [kg] of the moving nodes (n_nodes), 0 for the others.
    pub mass: Vec<Real>,
}

impl<'a> Mixed<'a> {
    /// `active` nodes of `levels`, coupled by `coupling` over rows of `kind`.
    pub fn new(levels: &'a Levels, active: Vec<bool>, law: Law, coupling: Coupling, kind: RowKind) -> Self {
        let mut weighted = Vec::new();
        let mut touched = vec![false; active.len()];
        for (e, element) in levels.elements.iter().enumerate() {
            let n_active = element.nodes.iter().filter(|n| active[**n]).count();
            if n_active > 0 {
                weighted.push((e, 0.25 * n_active as Real));
                element.nodes.iter().for_each(|n| touched[*n] = true);
            }
        }
        let wanted: Vec<usize> =
            (0..active.len()).filter(|n| touched[*n] && !active[*n] && !levels.fixed[*n]).collect();
        let found = rows(kind, levels, &active, &wanted);
        let moving: Vec<bool> = active.iter().zip(&levels.fixed).map(|(a, f)| *a && !f).collect();
        let interface = wanted.into_iter().zip(found).collect();
        let part = |(s, spring): (usize, &Spring)| {
            let n_active = spring.nodes.iter().filter(|n| active[**n]).count();
            (n_active > 0).then_some((s, 0.5 * n_active as Real))
        };
        let weighted_springs = levels.springs.iter().enumerate().filter_map(part).collect();
        let mass = vec![0.0; touched.len()];
        let mut mixed = Self { levels, law, coupling, moving, active, interface, weighted, weighted_springs, mass };
        mixed.lump_mass();
        mixed
    }

    /// Masses for the present weights.
    ///
    /// Coupled by forces: the quarter masses of the node's own level. Coupled by energy: masses travel with the rows,
    /// `m_j = Σ_i |P_ij| s_i m_i`, `s_i = Σ_k |P_ik|`, a diagonal that bounds `PᵀMP`, so that the step limit of the
    /// single element holds; the sum may exceed the body's mass.
    pub fn lump_mass(&mut self) {
        let mut own = vec![0.0; self.mass.len()];
        for (e, weight) in &self.weighted {
            let element = &self.levels.elements[*e];
            let weight = if self.coupling == Coupling::Force { 1.0 } else { *weight };
            for n in element.nodes {
                own[n] += 0.25 * self.levels.material.density * weight * element.volume;
            }
        }
        for (n, mass) in self.mass.iter_mut().enumerate() {
            *mass = if self.moving[n] { own[n] } else { 0.0 };
        }
        if self.coupling == Coupling::Energy {
            for (i, row) in &self.interface {
                let size: Real = row.iter().map(|(_, w)| w.abs()).sum();
                for (j, w) in row {
                    if self.moving[*j] {
                        self.mass[*j] += w.abs() * size * own[*i];
                    }
                }
            }
        }
    }

    /// Brings the interface nodes of `x` to where their masters put them.
    pub fn place_interface(&self, x: &mut [Vec3]) {
        for (i, row) in &self.interface {
            x[*i] = row.iter().map(|(j, w)| x[*j] * *w).sum();
        }
    }

    /// `U` [J] with the interface placed in `x` [m]. For the coupling by forces it is only a measure: no force derives
    /// from it.
    pub fn energy(&self, x: &[Vec3]) -> Real {
        if self.law == Law::MassSpring {
            let energy = |(s, w): &(usize, Real)| w * self.levels.springs[*s].energy(x);
            return self.levels.material.youngs_modulus() * self.weighted_springs.iter().map(energy).sum::<Real>();
        }
        let one = |(e, w): &(usize, Real)| {
            let element = &self.levels.elements[*e];
            w * element.volume * self.law.energy_density(&self.levels.material, &element.gradient_of(x))
        };
        self.weighted.iter().map(one).sum()
    }

    /// Elastic forces [N] on the moving nodes, with the interface placed in `x` [m]; zero for the others.
    pub fn force(&self, x: &[Vec3]) -> Vec<Vec3> {
        self.force_under(self.law, x)
    }

    fn force_under(&self, law: Law, x: &[Vec3]) -> Vec<Vec3> {
        let mut force = vec![Vec3::zeros(); x.len()];
        let (springs, elements) = match law {
            Law::MassSpring => (&self.weighted_springs[..], &[][..]),
            _ => (&[][..], &self.weighted[..]),
        };
        for (s, weight) in springs {
            let weight = if self.coupling == Coupling::Force { 1.0 } else { *weight };
            let spring = &self.levels.springs[*s];
            let pull = spring.pull(x) * (weight * self.levels.material.youngs_modulus());
            force[spring.nodes[0]] += pull;
            force[spring.nodes[1]] -= pull;
        }
        for (e, weight) in elements {
            let element = &self.levels.elements[*e];
            let weight = if self.coupling == Coupling::Force { 1.0 } else { *weight };
            let stress = law.stress(&self.levels.material, &element.gradient_of(x)) * (weight * element.volume);
            for (n, gradient) in element.nodes.iter().zip(&element.gradient) {
                force[*n] -= stress * gradient;
            }
        }
        if self.coupling == Coupling::Energy {
            for (i, row) in &self.interface {
                for (j, w) in row {
                    let pull = force[*i] * *w;
                    force[*j] += pull;
                }
            }
        }
        for (f, moving) in force.iter_mut().zip(&self.moving) {
            if !moving {
                *f = Vec3::zeros();
            }
        }
        force
    }

    /// Smallest altitude [m] of the elements that touch an active node.
    pub fn smallest_altitude(&self) -> Real {
        self.weighted.iter().map(|(e, _)| self.levels.altitude[*e]).fold(Real::INFINITY, Real::min)
    }

    /// Largest angular frequency [rad/s] at rest, by power iteration on `M⁻¹K` with K from small strain.
    ///
    /// The body may be given a smaller `mass` than the weights call for.
    pub fn largest_frequency(&self) -> Real {
        let mut random = super::levels::Random::new(7);
        let mut d: Vec<Vec3> = self.moving.iter().map(|m| if *m { random.in_cube() } else { Vec3::zeros() }).collect();
        let mut square = 0.0;
        for _ in 0..400 {
            let length = d.iter().zip(&self.mass).map(|(d, m)| m * d.norm_squared()).sum::<Real>().sqrt();
            d.iter_mut().for_each(|d| *d /= length);
            // Cauchy's forces are linear, so any displacement is small enough.
            let mut x: Vec<Vec3> = self.levels.rest.iter().zip(&d).map(|(u, d)| u + d).collect();
            self.place_interface(&mut x);
            let force = self.force_under(Law::Cauchy, &x);
            square = -force.iter().zip(&d).map(|(f, d)| f.dot(d)).sum::<Real>();
            for (n, d) in d.iter_mut().enumerate() {
                *d = if self.moving[n] { -force[n] / self.mass[n] } else { Vec3::zeros() };
            }
        }
        square.max(0.0).sqrt()
    }
}

/// Positions and velocities of all nodes; only those of moving nodes count.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Positions [m] (n_nodes).
    pub x: Vec<Vec3>,
    /// Velocities [m/s] (n_nodes).
    pub v: Vec<Vec3>,
    /// Forces [N] at `x`, gravity included (n_nodes).
    force: Vec<Vec3>,
    /// Field [m/s²].
    pub gravity: Vec3,
}

/// What a motion holds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Kinetic, elastic and gravity together [J].
    pub energy: Real,
    /// Kinetic alone [J].
    pub kinetic: Real,
    /// Σ m v [kg·m/s].
    pub momentum: Vec3,
    /// Σ m x × v [kg·m²/s].
    pub angular_momentum: Vec3,
}

impl Motion {
    /// At rest positions with velocities `v` [m/s] in the field `gravity` [m/s²].
    pub fn new(mixed: &Mixed, v: Vec<Vec3>, gravity: Vec3) -> Self {
        let x = mixed.levels.rest.clone();
        let mut motion = Self { force: Vec::new(), x, v, gravity };
        motion.evaluate(mixed);
        motion
    }

    fn evaluate(&mut self, mixed: &Mixed) {
        mixed.place_interface(&mut self.x);
        self.force = mixed.force(&self.x);
        for (f, m) in self.force.iter_mut().zip(&mixed.mass) {
            *f += self.gravity * *m;
        }
    }

    /// One step of velocity Verlet of `dt` [s] for all nodes together.
    pub fn step(&mut self, mixed: &Mixed, dt: Real) {
        self.kick(mixed, 0.5 * dt);
        for n in 0..self.x.len() {
            if mixed.moving[n] {
                self.x[n] += self.v[n] * dt;
            }
        }
        self.evaluate(mixed);
        self.kick(mixed, 0.5 * dt);
    }

    fn kick(&mut self, mixed: &Mixed, dt: Real) {
        for n in 0..self.x.len() {
            if mixed.moving[n] {
                self.v[n] += self.force[n] * (dt / mixed.mass[n]);
            }
        }
    }

    /// Energies and momenta now.
    pub fn sums(&self, mixed: &Mixed) -> Sums {
        let mut sums = Sums { energy: mixed.energy(&self.x), ..Sums::default() };
        for n in 0..self.x.len() {
            let (m, x, v) = (mixed.mass[n], self.x[n], self.v[n]);
            sums.kinetic += 0.5 * m * v.norm_squared();
            sums.energy -= m * self.gravity.dot(&(x - mixed.levels.rest[n]));
            sums.momentum += v * m;
            sums.angular_momentum += x.cross(&v) * m;
        }
        sums.energy += sums.kinetic;
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::levels::Random;
    use palpate_core::model::Material;

    fn levels(clamped: bool) -> Levels {
        let material = Material::from_young(2e5, 0.33, 1000.0);
        Levels::of_box(Vec3::repeat(1.0), &[[2; 3], [3; 3], [4; 3]], material, clamped)
    }

    fn shaken(mixed: &Mixed, size: Real) -> Vec<Vec3> {
        let mut random = Random::new(3);
        let mut x: Vec<Vec3> = mixed.levels.rest.clone();
        x.iter_mut().zip(&mixed.moving).filter(|(_, m)| **m).for_each(|(x, _)| *x += random.in_cube() * size);
        mixed.place_interface(&mut x);
        x
    }

    const KINDS: [RowKind; 2] = [RowKind::Hosts, RowKind::MovingLeastSquares];

    #[test]
    fn only_the_coupling_by_energy_is_the_gradient_of_an_energy() {
        let levels = levels(true);
        for (kind, law) in [(KINDS[0], Law::Green), (KINDS[1], Law::Green), (KINDS[0], Law::MassSpring)] {
            for (coupling, is_gradient) in [(Coupling::Energy, true), (Coupling::Force, false)] {
                let mixed = Mixed::new(&levels, levels.random_active_set(2), law, coupling, kind);
                let x = shaken(&mixed, 0.03);
                let force = mixed.force(&x);
                let largest = force.iter().map(|f| f.norm()).fold(0.0, Real::max);
                let h = 1e-6;
                let mut worst: Real = 0.0;
                for n in (0..x.len()).filter(|n| mixed.moving[*n]) {
                    for axis in 0..3 {
                        let energy = |step: Real| {
                            let mut moved = x.clone();
                            moved[n][axis] += step;
                            mixed.place_interface(&mut moved);
                            mixed.energy(&moved)
                        };
                        worst = worst.max((force[n][axis] + (energy(h) - energy(-h)) / (2.0 * h)).abs());
                    }
                }
                assert_eq!(worst < 1e-6 * largest, is_gradient, "{law:?} {kind:?} {coupling:?}: {worst} of {largest}");
            }
        }
    }

    #[test]
    fn a_free_body_coupled_by_energy_feels_no_net_force_and_no_net_torque() {
        let levels = levels(false);
        for kind in KINDS {
            for seed in 0..4 {
                let active = levels.random_active_set(seed);
                let mixed = Mixed::new(&levels, active.clone(), Law::Green, Coupling::Energy, kind);
                let x = shaken(&mixed, 0.03);
                let force = mixed.force(&x);
                let scale: Real = force.iter().map(|f| f.norm()).sum();
                let torque: Vec3 = x.iter().zip(&force).map(|(x, f)| x.cross(f)).sum();
                assert!(force.iter().sum::<Vec3>().norm() < 1e-11 * scale, "{kind:?} {seed}");
                assert!(torque.norm() < 1e-9 * scale, "{kind:?} {seed}: {torque}");
                let printed = Mixed::new(&levels, active, Law::Green, Coupling::Force, kind);
                assert!(printed.force(&x).iter().sum::<Vec3>().norm() > 1e-3 * scale);
            }
        }
    }

    #[test]
    fn masses_that_travel_with_the_rows_keep_the_step_long() {
        let levels = levels(false);
        for kind in KINDS {
            for seed in 0..4 {
                let active = levels.random_active_set(seed);
                let mixed = Mixed::new(&levels, active, Law::Green, Coupling::Energy, kind);
                // Measured 1.47–2.0; with each node's own quarter masses instead 1.15–1.30.
                let limit = 2.0 / mixed.largest_frequency() * levels.material.wave_speed() / mixed.smallest_altitude();
                assert!(limit > 1.4, "{kind:?} {seed}: {limit}");
            }
        }
    }
}
