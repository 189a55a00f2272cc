//! The method as printed, on mixed resolution: forces from a node's own level, interface nodes that only follow, steps
//! per node that are powers of two [DDCB01 eq. 10], the semi-implicit filter [eq. 11], splitting and merging by γ
//! [eq. 9].
//!
//! It does not hold up without damping: study `steps`, and the claims about its loop under a tool.

use super::Progress;
use super::coupling::{Coupling, Mixed};
use super::laws::{Law, viscous_stress};
use super::levels::Levels;
use super::oscillate::{GRAVITY, damped, material};
use super::plot::table;
use super::rows::{RowKind, rows};
use palpate_core::math::{Mat3, Real, Vec3};
use std::io::Result;
use std::path::Path;

/// Frame period [s]: all nodes meet at its end.
pub const FRAME: Real = 0.032;

/// When a node steps, and what it then takes its neighbours' positions to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stepping {
    /// All nodes take the shortest step of any.
    Together,
    /// Each node its own step; neighbours stand where they last arrived, which is ahead of the present.
    OwnStale,
    /// Each node its own step; neighbours are brought to the present along their velocity.
    OwnPredicted,
}

impl Stepping {
    /// Words for a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Together => "one step for all",
            Self::OwnStale => "own step, neighbours stale (printed)",
            Self::OwnPredicted => "own step, neighbours predicted",
        }
    }
}

/// How the printed method is run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// When nodes step.
    pub stepping: Stepping,
    /// Filter velocities by eq. 11, and take twice the step for it, as the paper allows.
    pub filter: bool,
    /// Part of the step of eq. 10 that is taken; the paper takes 1.
    pub safety: Real,
    /// Split above the second and merge below the first γ [m]; a fixed set of nodes when absent.
    pub gamma: Option<[Real; 2]>,
    /// Field [m/s²].
    pub gravity: Vec3,
}

/// A body that moves by the printed method.
pub struct Printed<'a> {
    mixed: Mixed<'a>,
    options: Options,
    /// Positions [m], of each node at the time it is next due (n_nodes).
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    /// Elements around each node, of its own level (n_nodes).
    around: Vec<Vec<usize>>,
    /// Distance to the nearest neighbour on the same level [m] (n_nodes).
    spacing: Vec<Real>,
    /// Substeps of a frame are `2^finest`.
    finest: u32,
    /// Steps of a frame are `2^this` (n_nodes).
    time_level: Vec<u32>,
    /// `(I − dt²/m J)⁻¹` (n_nodes).
    filter: Vec<Mat3>,
    /// Forces at the last step of each node, for γ and for the tool [N] (n_nodes).
    last_force: Vec<Vec3>,
    /// Velocity [m/s] of the nodes that a tool moves (n_nodes).
    held: Vec<Option<Vec3>>,
    /// Centre and radius [m] of a ball that collides.
    tool: Option<(Vec3, Real)>,
}

impl<'a> Printed<'a> {
    /// `active` nodes of `levels` at rest, moving with the velocities `v` [m/s].
    pub fn new(levels: &'a Levels, active: Vec<bool>, v: Vec<Vec3>, options: Options) -> Self {
        let n_nodes = levels.rest.len();
        let mut around = vec![Vec::new(); n_nodes];
        let mut spacing = vec![Real::INFINITY; n_nodes];
        for (e, element) in levels.elements.iter().enumerate() {
            for n in element.nodes {
                around[n].push(e);
                for m in element.nodes.into_iter().filter(|m| *m != n) {
                    spacing[n] = spacing[n].min((levels.rest[n] - levels.rest[m]).norm());
                }
            }
        }
        let mixed = Mixed::new(levels, active, Law::Green, Coupling::Force, RowKind::Hosts);
        let mut printed = Self {
            mixed,
            options,
            x: levels.rest.clone(),
            v,
            around,
            spacing,
            finest: 0,
            time_level: vec![0; n_nodes],
            filter: vec![Mat3::identity(); n_nodes],
            last_force: vec![Vec3::zeros(); n_nodes],
            held: vec![None; n_nodes],
            tool: None,
        };
        printed.choose_steps();
        printed
    }

    /// The largest step that eq. 10 allows each node, as a power of two of a frame, and the filter that goes with it.
    fn choose_steps(&mut self) {
        let material = &self.mixed.levels.material;
        let longer = if self.options.filter { 2.0 } else { 1.0 };
        self.finest = 0;
        for n in (0..self.x.len()).filter(|n| self.mixed.active[*n]) {
            let limit = longer * self.options.safety * self.spacing[n] / material.wave_speed();
            let mut level = 0;
            while FRAME / Real::from(1u32 << level) > limit {
                level += 1;
            }
            self.time_level[n] = level;
            self.finest = self.finest.max(level);
        }
        if self.options.stepping == Stepping::Together {
            self.time_level.iter_mut().for_each(|l| *l = self.finest);
        }
        for n in (0..self.x.len()).filter(|n| self.options.filter && self.mixed.moving[*n]) {
            // ∂f_i/∂x_i at rest with the neighbours fixed: the diagonal block of the linear stiffness.
            let mut stiffness = Mat3::zeros();
            for e in &self.around[n] {
                let element = &self.mixed.levels.elements[*e];
                let g = element.gradient[element.nodes.iter().position(|m| *m == n).unwrap_or(0)];
                stiffness += (g * g.transpose() * (material.lambda + material.mu)
                    + Mat3::identity() * (material.mu * g.norm_squared()))
                    * element.volume;
            }
            let dt = self.dt(n);
            let matrix = Mat3::identity() + stiffness * (dt * dt / self.mixed.mass[n]);
            self.filter[n] = matrix.try_inverse().unwrap_or_else(Mat3::identity);
        }
    }

    fn dt(&self, n: usize) -> Real {
        FRAME / Real::from(1u32 << self.time_level[n])
    }

    /// From now on a `tool`, the centre and radius of a ball [m], moves `nodes` with these velocities [m/s], and no others.
    /// Closer to it than their spacing nodes are as fine as there are ["a high resolution mesh … is always used near the
    /// rigid tool when there is a collision", 4.2].
    pub fn hold(&mut self, nodes: &[(usize, Vec3)], tool: (Vec3, Real)) {
        self.held.fill(None);
        nodes.iter().for_each(|(n, velocity)| self.held[*n] = Some(*velocity));
        self.tool = (!nodes.is_empty()).then_some(tool);
    }

    fn is_near_the_tool(&self, n: usize) -> bool {
        self.tool.is_some_and(|(centre, radius)| (self.x[n] - centre).norm() < radius + self.spacing[n])
    }

    /// Nodes that the tool moves, with the elastic and viscous force [N] of the body on each at its last step.
    pub fn transmitted(&self) -> impl Iterator<Item = (usize, Vec3)> + '_ {
        (0..self.x.len()).filter(|n| self.held[*n].is_some()).map(|n| (n, self.last_force[n]))
    }

    /// Which nodes are active (n_nodes).
    pub fn active(&self) -> &[bool] {
        &self.mixed.active
    }

    /// Positions [m], interface nodes included (n_nodes); at the end of a frame all are of one time.
    pub fn positions(&self) -> &[Vec3] {
        &self.x
    }

    /// One frame of 32 ms [DDCB01 fig. 7]; `each` sees the body after every substep, with the time since the frame began [s].
    pub fn frame(&mut self, each: &mut dyn FnMut(&Self, Real)) {
        for substep in 0..(1u32 << self.finest) {
            let due: Vec<usize> = (0..self.x.len())
                .filter(|n| self.mixed.active[*n])
                .filter(|n| substep.is_multiple_of(1 << (self.finest - self.time_level[*n])))
                .collect();
            let seen = self.positions_seen(substep);
            let forces: Vec<Vec3> = due.iter().map(|n| self.force_on(*n, &seen)).collect();
            for (n, force) in due.into_iter().zip(forces) {
                self.last_force[n] = force;
                let dt = self.dt(n);
                if let Some(velocity) = self.held[n] {
                    self.v[n] = velocity;
                    self.x[n] += velocity * dt;
                } else if self.mixed.moving[n] {
                    self.v[n] += (force / self.mixed.mass[n] + self.options.gravity) * dt;
                    if self.options.filter {
                        self.v[n] = self.filter[n] * self.v[n];
                    }
                    self.x[n] += self.v[n] * dt;
                }
            }
            each(self, FRAME * Real::from(substep + 1) / Real::from(1u32 << self.finest));
        }
        self.mixed.place_interface(&mut self.x);
        self.mixed.place_interface(&mut self.v);
        if let Some(thresholds) = self.options.gamma {
            self.split_and_merge(thresholds);
        }
    }

    /// Positions from which forces are taken at `substep`, interface nodes included.
    fn positions_seen(&self, substep: u32) -> Vec<Vec3> {
        let mut seen = self.x.clone();
        if self.options.stepping == Stepping::OwnPredicted {
            for n in (0..seen.len()).filter(|n| self.mixed.moving[*n]) {
                let stride = 1 << (self.finest - self.time_level[n]);
                // A node that has stepped stands at the end of its step; one that is due stands at the present.
                let ahead = (stride - substep % stride) % stride;
                seen[n] -= self.v[n] * (FRAME * Real::from(ahead) / Real::from(1u32 << self.finest));
            }
        }
        self.mixed.place_interface(&mut seen);
        seen
    }

    /// Elastic and viscous force [N] on `n` from the elements of its own level around it.
    fn force_on(&self, n: usize, x: &[Vec3]) -> Vec3 {
        let levels = self.mixed.levels;
        let material = &levels.material;
        let mut force = Vec3::zeros();
        for e in &self.around[n] {
            let element = &levels.elements[*e];
            let f = element.gradient_of(x);
            let mut stress = self.mixed.law.stress(material, &f);
            if material.psi > 0.0 {
                stress += viscous_stress(material, &f, &element.gradient_of(&self.v));
            }
            let place = element.nodes.iter().position(|m| *m == n).unwrap_or(0);
            force -= stress * element.gradient[place] * element.volume;
        }
        force
    }

    /// γ of an active node [m]: `|f| / h` per unit of `λ + 2μ` [DDCB01 eq. 9].
    pub fn gamma(&self, n: usize) -> Real {
        self.last_force[n].norm() / (self.spacing[n] * self.mixed.levels.material.pressure_modulus())
    }

    /// Splits active nodes above the upper threshold and merges families that lie wholly below the lower one. New nodes
    /// stand where the old ones say.
    fn split_and_merge(&mut self, [merge_below, split_above]: [Real; 2]) {
        let levels = self.mixed.levels;
        let before = &self.mixed.active;
        let mut active = before.clone();
        for n in 0..active.len() {
            let may_go =
                |c: &usize| before[*c] && active[*c] && !self.is_near_the_tool(*c) && self.gamma(*c) < merge_below;
            if before[n] && (self.gamma(n) > split_above || self.is_near_the_tool(n)) {
                levels.split(&mut active, n);
            } else if !levels.children[n].is_empty() && levels.children[n].iter().all(may_go) {
                levels.merge(&mut active, n);
            }
        }
        if active == *before {
            return;
        }
        let new: Vec<usize> = (0..active.len()).filter(|n| active[*n] && !before[*n] && !levels.fixed[*n]).collect();
        let found = rows(RowKind::Hosts, levels, before, &new);
        let at = |field: &[Vec3]| -> Vec<Vec3> {
            found.iter().map(|row| row.iter().map(|(j, w)| field[*j] * *w).sum()).collect()
        };
        let (x, v) = (at(&self.x), at(&self.v));
        for (i, n) in new.into_iter().enumerate() {
            (self.x[n], self.v[n], self.last_force[n]) = (x[i], v[i], Vec3::zeros());
        }
        self.mixed = Mixed::new(levels, active, Law::Green, Coupling::Force, RowKind::Hosts);
        self.mixed.place_interface(&mut self.x);
        self.mixed.place_interface(&mut self.v);
        self.choose_steps();
    }

    /// Kinetic and total energy [J], the interface's share by quarter weights.
    pub fn energies(&self) -> (Real, Real) {
        let (mut kinetic, mut gravity) = (0.0, 0.0);
        for n in (0..self.x.len()).filter(|n| self.mixed.moving[*n]) {
            kinetic += 0.5 * self.mixed.mass[n] * self.v[n].norm_squared();
            gravity -= self.mixed.mass[n] * self.options.gravity.dot(&(self.x[n] - self.mixed.levels.rest[n]));
        }
        (kinetic, kinetic + gravity + self.mixed.energy(&self.x))
    }
}

/// Which choices of step and filter keep the energy of a clamped cube under gravity, over 10 s.
pub fn steps(out: &Path, progress: Progress) -> Result<String> {
    let duration = 10.0;
    let mut table_rows = Vec::new();
    for tau in [0.0, 0.002] {
        let levels = Levels::of_cube(damped(tau), true);
        for (body, active) in [("uniform, 216 nodes", levels.uniform(1)), ("mixed", levels.random_active_set(0))] {
            progress(&format!("steps: {body}, τ = {tau} s"));
            for safety in [1.0, 0.4] {
                for stepping in [Stepping::Together, Stepping::OwnStale, Stepping::OwnPredicted] {
                    for filter in [false, true] {
                        let options = Options { stepping, filter, safety, gamma: None, gravity: GRAVITY };
                        let still = vec![Vec3::zeros(); levels.rest.len()];
                        let mut printed = Printed::new(&levels, active.clone(), still, options);
                        let (mut fastest, mut highest, mut last): (Real, Real, Real) = (0.0, 0.0, 0.0);
                        let mut blown = None;
                        for frame in 1..=(duration / FRAME) as usize {
                            printed.frame(&mut |_, _| ());
                            let (kinetic, total) = printed.energies();
                            // The first second: the cube falls through its position of rest in it.
                            if frame <= 31 {
                                fastest = fastest.max(kinetic);
                            }
                            (highest, last) = (highest.max(total), total);
                            if total.is_nan() || total.abs() > 1e5 {
                                blown = Some(frame as Real * FRAME);
                                break;
                            }
                        }
                        let (verdict, end) = match blown {
                            Some(time) => (format!("blows up at {time:.1} s"), "–".to_owned()),
                            None => (format!("{fastest:.0}"), format!("{last:+.0} ({highest:+.0})")),
                        };
                        table_rows.push(vec![
                            body.into(),
                            format!("{:.0}", 1000.0 * tau),
                            format!("{safety}"),
                            stepping.name().into(),
                            if filter { "yes" } else { "no" }.into(),
                            verdict,
                            end,
                        ]);
                    }
                }
            }
        }
    }
    let header = [
        "body",
        "τ [ms]",
        "of eq. 10",
        "stepping",
        "filter (step × 2)",
        "peak kinetic energy in 1 s [J]",
        "energy change in 10 s [J] (highest)",
    ];
    let text = table(out, "steps", &header, &table_rows)?;

    // Eq. 11 filters the whole velocity, so even a body that only flies along is slowed down.
    let levels = Levels::of_box(Vec3::repeat(1.0), &[[3; 3], [5; 3]], material(), false);
    let mut drag = String::new();
    for safety in [0.25, 0.5, 1.0] {
        let options =
            Options { stepping: Stepping::Together, filter: true, safety, gamma: None, gravity: Vec3::zeros() };
        let mut printed = Printed::new(&levels, levels.uniform(1), vec![Vec3::x(); levels.rest.len()], options);
        let before = printed.energies().0;
        printed.frame(&mut |_, _| ());
        let rate = -0.5 * (printed.energies().0 / before).ln() / FRAME;
        drag += &format!("- filter at {safety} × 2 of eq. 10: a body in free flight loses speed at {rate:.1} /s\n");
    }
    Ok(format!("{text}\n{drag}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(stepping: Stepping) -> Options {
        Options { stepping, filter: false, safety: 0.5, gamma: None, gravity: Vec3::zeros() }
    }

    #[test]
    fn free_flight_is_exact_with_any_stepping() {
        let levels = Levels::of_box(Vec3::repeat(1.0), &[[2; 3], [3; 3]], material(), false);
        let v = Vec3::new(0.3, -0.2, 0.1);
        for stepping in [Stepping::Together, Stepping::OwnPredicted] {
            let speeds = vec![v; levels.rest.len()];
            let mut printed = Printed::new(&levels, levels.random_active_set(0), speeds, options(stepping));
            (0..10).for_each(|_| printed.frame(&mut |_, _| ()));
            for n in (0..printed.x.len()).filter(|n| printed.mixed.active[*n]) {
                assert!((printed.x[n] - levels.rest[n] - v * (10.0 * FRAME)).norm() < 1e-10);
            }
        }
    }

    #[test]
    fn the_filter_drags_a_body_that_only_flies() {
        let levels = Levels::of_box(Vec3::repeat(1.0), &[[2; 3], [3; 3]], material(), false);
        let options = Options { filter: true, ..options(Stepping::Together) };
        let mut printed = Printed::new(&levels, levels.uniform(1), vec![Vec3::x(); levels.rest.len()], options);
        let before = printed.energies().0;
        printed.frame(&mut |_, _| ());
        assert!(printed.energies().0 < 0.9 * before);
    }

    #[test]
    fn splitting_and_merging_keep_affine_motion() {
        let levels = Levels::of_box(Vec3::repeat(1.0), &[[2; 3], [3; 3], [4; 3]], material(), false);
        let still = vec![Vec3::zeros(); levels.rest.len()];
        let mut printed = Printed::new(&levels, levels.uniform(0), still, options(Stepping::Together));
        let f = Mat3::new(1.1, 0.1, 0.0, -0.1, 0.9, 0.05, 0.0, 0.1, 1.0);
        printed.x = levels.rest.iter().map(|u| f * u).collect();
        printed.v = printed.x.clone();
        printed.last_force = vec![Vec3::repeat(1e9); levels.rest.len()];
        printed.split_and_merge([0.0, 1.0]);
        assert_eq!(printed.mixed.active, levels.uniform(1));
        for n in levels.first_node[1]..levels.first_node[2] {
            assert!((printed.x[n] - f * levels.rest[n]).norm() < 1e-12);
            assert!((printed.v[n] - f * levels.rest[n]).norm() < 1e-12);
        }
        printed.last_force = vec![Vec3::zeros(); levels.rest.len()];
        printed.split_and_merge([1.0, 2.0]);
        assert_eq!(printed.mixed.active, levels.uniform(0));
    }
}
