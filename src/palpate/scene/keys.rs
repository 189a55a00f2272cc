//! The keys of a scene, each with its range and default, and what follows from them.

use super::body_keys::{BodyKeys, HoldKeys, MaterialKeys, RegionKeys};
use super::contact_keys::{self, ContactKeys};
use super::obstacle_keys::ObstacleKeys;
use super::organ_keys::OrganKeys;
use super::tool_keys::{ToolKeys, centimetre};
use crate::display::Display;
use garde::Validate;
use palpate_body::geometry::textured::TexturedMesh;
use palpate_body::prepare::inclusions::Inclusion;
use palpate_core::adaptation::{Adaptivity, finest_steppable};
use palpate_core::contact::obstacle::{MOST_OBSTACLES, Obstacle};
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Following, MOST_TOOLS};
use palpate_core::geometry::locate::{Host, Locator};
use palpate_core::ids::{Element, OrganId};
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::organ::MOST_ORGANS;
use palpate_core::model::step_class::step_of;
use palpate_core::model::{Body, Material, SupportMotion};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot, TICK};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A scene as written, every key with its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct Scene {
    /// Name of the body, for people.
    #[garde(length(min = 1, max = 64))]
    pub name: String,
    /// Its shape and levels.
    #[garde(dive)]
    pub body: BodyKeys,
    /// Its material.
    #[serde(default)]
    #[garde(dive)]
    pub material: MaterialKeys,
    /// When to refine and coarsen.
    #[serde(default)]
    #[garde(dive)]
    pub resolution: ResolutionKeys,
    /// Regions held in space.
    #[serde(default)]
    #[garde(dive, length(max = 64))]
    pub hold: Vec<HoldKeys>,
    /// Further bodies beside it, which meet it and each other.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(dive, length(max = MOST_ORGANS - 1))]
    pub organ: Vec<OrganKeys>,
    /// What is between two organs that meet.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(dive, length(max = MOST_ORGANS * (MOST_ORGANS - 1) / 2))]
    pub contact: Vec<ContactKeys>,
    /// Rigid things that the bodies meet.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(dive, length(max = MOST_OBSTACLES))]
    pub obstacle: Vec<ObstacleKeys>,
    /// Tools that clients may take; one ball when the list is empty.
    #[serde(default = "one_ball")]
    #[garde(dive, length(min = 1, max = MOST_TOOLS))]
    pub tool: Vec<ToolKeys>,
    /// Gravity and settling.
    #[serde(default)]
    #[garde(dive)]
    pub world: WorldKeys,
    /// Limits on poses and forces.
    #[serde(default)]
    #[garde(dive)]
    pub safety: SafetyKeys,
    /// Points whose motion `simulate` writes down.
    #[serde(default)]
    #[garde(dive, length(max = 64))]
    pub probe: Vec<ProbeKeys>,
    /// What the files of `display` hold [m], by organ and in its frame; empty before they are read.
    #[serde(skip)]
    pub shown: Vec<Option<Arc<TexturedMesh>>>,
}

/// `[resolution]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct ResolutionKeys {
    /// Strain jump (mean deviation from the mean strain around a node) above which a node is split.
    #[garde(range(min = 1e-4, max = 10.0))]
    pub split: Real,
    /// Part of `split` below which nodes are merged again.
    #[garde(range(min = 0.0, max = 0.9))]
    pub merge: Real,
    /// Nodes closer to a tool than this many spacings of their level are split.
    #[garde(range(min = 0.0, max = 10.0))]
    pub reach: Real,
    /// Finest level to be used; left out: the finest that can be stepped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub finest_level: Option<u32>,
    /// Most elements in use at once: what memory is made for.
    #[garde(range(min = 100, max = 4_000_000))]
    pub most_elements: usize,
}

impl Default for ResolutionKeys {
    fn default() -> Self {
        let Adaptivity { split, merge, reach, .. } = Adaptivity::default();
        Self { split, merge, reach, finest_level: None, most_elements: 60_000 }
    }
}

/// `[world]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct WorldKeys {
    /// Gravity [m/s²].
    #[garde(inner(range(min = -100.0, max = 100.0)))]
    pub gravity: [Real; 3],
    /// How long the body comes to rest under its load before it is served [s].
    #[garde(range(min = 0.0, max = 60.0))]
    pub settle: Real,
    /// It may start before it is at rest, crushed, or away from where it was put.
    pub unsettled: bool,
}

impl Default for WorldKeys {
    fn default() -> Self {
        Self { gravity: [0.0, 0.0, -9.81], settle: 2.0, unsettled: false }
    }
}

/// `[safety]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct SafetyKeys {
    /// Largest rendered force [N].
    #[garde(range(min = 0.01, max = 100.0))]
    pub force_limit: Real,
    /// Largest rendered torque [N·m].
    #[garde(range(min = 1e-4, max = 10.0))]
    pub torque_limit: Real,
    /// Fastest change of the rendered force [N/s].
    #[garde(range(min = 1.0, max = 1e5))]
    pub slew_limit: Real,
    /// Fastest that a touching tool moves [m/s].
    #[garde(range(min = 0.01, max = 1.5))]
    pub tool_speed: Real,
    /// Rise of the force from zero at engage [s].
    #[garde(range(min = 0.001, max = 5.0))]
    pub engage_time: Real,
    /// How far poses may be outside the body's box [m]; those beyond are refused.
    #[garde(range(min = 0.01, max = 10.0))]
    pub workspace_margin: Real,
}

impl Default for SafetyKeys {
    fn default() -> Self {
        Self {
            force_limit: 3.3,
            torque_limit: 0.2,
            slew_limit: 1000.0,
            tool_speed: 1.0,
            engage_time: 0.1,
            workspace_margin: 0.5,
        }
    }
}

/// `[[probe]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct ProbeKeys {
    /// Column name.
    #[garde(length(min = 1, max = 32))]
    pub name: String,
    /// Place at rest [m].
    #[garde(inner(range(min = -1e3, max = 1e3)))]
    pub position: [Real; 3],
}

fn one_ball() -> Vec<ToolKeys> {
    vec![ToolKeys::ball("ball", centimetre())]
}
impl Scene {
    /// The material's constants.
    pub fn material(&self) -> Material {
        let keys = &self.material;
        let elastic = keys.elastic();
        Material {
            phi: keys.phi.unwrap_or(elastic.lambda * keys.damping_time),
            psi: keys.psi.unwrap_or(elastic.mu * keys.damping_time),
            ..elastic
        }
    }

    /// Where the material is stiffer or softer.
    pub fn inclusions(&self) -> Vec<Inclusion> {
        let (_, rest) = self.material.elastic_keys().young();
        let inclusion = |region: &RegionKeys| {
            let (youngs_modulus, poisson_ratio) = region.young(rest);
            let law = region.law_keys(&self.material.law_keys());
            Some(Inclusion {
                place: region.place()?,
                youngs_modulus,
                poisson_ratio,
                density: region.density.unwrap_or(self.material.density),
                neo_hookean: law.neo_hookean(),
                fibres: law.fibres(),
            })
        };
        self.material.region.iter().filter_map(inclusion).collect()
    }

    /// The scene of `organ` alone, in its own frame; all else is as here.
    pub fn of_organ(&self, organ: &OrganKeys) -> Self {
        let mut material = organ.material.in_scene(&self.material);
        // Viscosities that the scene gives stand for relaxation times, which are the same in every organ.
        let (own, first) = (material.elastic(), self.material.elastic());
        let as_stiff = |viscosity: Option<Real>, own: Real, first: Real| {
            viscosity.map(|viscosity| if first > 0.0 { viscosity * own / first } else { 0.0 })
        };
        material.phi = as_stiff(self.material.phi, own.lambda, first.lambda);
        material.psi = as_stiff(self.material.psi, own.mu, first.mu);
        Self {
            name: organ.name.clone(),
            body: organ.body.clone(),
            material,
            hold: organ.hold.clone(),
            organ: Vec::new(),
            contact: Vec::new(),
            ..self.clone()
        }
    }

    /// Names of its organs, in the order of their numbers.
    pub fn organ_names(&self) -> Vec<&str> {
        std::iter::once(&*self.name).chain(self.organ.iter().map(|organ| &*organ.name)).collect()
    }

    /// The simulation's settings.
    pub fn settings(&self) -> Settings {
        Settings {
            gravity: Vec3::from(self.world.gravity),
            tools: self.tool.iter().map(ToolKeys::tool).collect(),
            obstacles: self.obstacle.iter().map(ObstacleKeys::obstacle).collect(),
            organ_friction: contact_keys::friction(&self.contact, &self.organ_names()),
            support_motions: self.support_motions(),
            following: Following {
                speed: self.safety.tool_speed,
                engage_ticks: (self.safety.engage_time / TICK).ceil() as u32,
            },
            limits: ForceLimits {
                force: self.safety.force_limit,
                torque: self.safety.torque_limit,
                slew: self.safety.slew_limit,
            },
            adaptivity: self.body.active_level.is_none().then(|| Adaptivity {
                split: self.resolution.split,
                merge: self.resolution.merge,
                reach: self.resolution.reach,
                finest: self.resolution.finest_level.map_or(usize::MAX, |r| r as usize),
            }),
            most_elements: self.resolution.most_elements,
        }
    }

    /// How its holds move.
    fn support_motions(&self) -> Vec<SupportMotion> {
        let first = self.hold.iter().map(|hold| (hold, Pose::default(), 0));
        let further = self
            .organ
            .iter()
            .zip(1..)
            .flat_map(|(organ, i)| organ.hold.iter().map(move |hold| (hold, organ.pose(), i)));
        first.chain(further).filter_map(|(hold, frame, i)| hold.support_motion(OrganId::at(i), frame)).collect()
    }

    /// [`Scene::settings`] with supports and obstacles that stay where they begin: what a start settles under, and is judged by.
    pub(super) fn still_settings(&self) -> Settings {
        let Settings { obstacles, .. } = self.settings();
        let still = obstacles.into_iter().map(|obstacle| Obstacle { motion: None, ..obstacle });
        Settings { obstacles: still.collect(), support_motions: Vec::new(), ..self.settings() }
    }

    /// What of `body` this scene cannot use, in words.
    pub fn warning(&self, body: &Body) -> Option<String> {
        let usable = finest_steppable(body);
        let wanted = self.body.active_level.or(self.resolution.finest_level).map_or(body.finest(), |r| r as usize);
        (wanted > usable).then(|| {
            format!(
                "{}: the elements of level {} need steps below {:.0} µs and cannot be simulated; levels up to {usable} \
                 are used",
                body.name(),
                usable + 1,
                1e6 * step_of(CLASSES - 1)
            )
        })
    }

    /// What viewers are shown of `body`.
    ///
    /// # Errors
    /// When a surface to look at is not where its organ is, in words.
    pub fn display(&self, body: &Body) -> Result<Display, String> {
        let poses = std::iter::once(Pose::default()).chain(self.organ.iter().map(OrganKeys::pose));
        let own: Vec<_> = self.shown.iter().cloned().zip(poses).map(|(mesh, pose)| Some((mesh?, pose))).collect();
        Display::new(body, &own).map_err(|(organ, far)| format!("{}: {far}", body.organs()[organ].name))
    }

    /// (organs) vertices and triangles that viewers are shown of each organ of `body`.
    pub fn shown_counts(&self, body: &Body) -> Vec<[usize; 2]> {
        let own = |i: usize| self.shown.get(i).and_then(Option::as_ref).map(|mesh| &mesh.surface);
        let counts = body.organs().iter().enumerate().map(|(i, organ)| match own(i) {
            Some(surface) => [surface.vertices.len(), surface.triangles.len()],
            None => [organ.vertices.len(), organ.triangles.len()],
        });
        counts.collect()
    }

    /// The box that poses must lie in [m].
    pub fn workspace(&self, body: &Body) -> Bounds {
        body.surface().bounds().grown(self.safety.workspace_margin)
    }

    /// Where each probe lies on each level that reaches there, coarsest first.
    pub fn probes(&self, body: &Body) -> Vec<Vec<Host<Element>>> {
        let on = |r: usize, p: &ProbeKeys| {
            let host = Locator::new(&body.level(r).mesh, body.level(r).spacing).host(Vec3::from(p.position));
            let reaches = body.level(r).is_whole() || host.extrapolation() > -0.5;
            body.host_on(r, host).filter(|_| reaches)
        };
        self.probe.iter().map(|p| (0..body.levels().len()).filter_map(|r| on(r, p)).collect()).collect()
    }

    /// The body at rest, as it starts before it settles.
    pub fn at_rest(&self, body: &Body) -> Snapshot {
        let level = self.body.active_level.map_or(0, |r| r as usize);
        Snapshot::at_rest(body, level.min(finest_steppable(body)), self.tool.len())
    }

    /// The state in which `body` has come to rest under its load: `world.settle` seconds of ticks in which its
    /// velocities fade, so that it does not swing when it is first touched.
    pub fn settled(&self, body: &Arc<Body>, progress: &mut dyn FnMut(&str, usize, usize)) -> Snapshot {
        let rest = self.at_rest(body);
        let ticks = (self.world.settle / TICK) as usize;
        let Ok(mut simulation) = Simulation::new(body.clone(), self.still_settings(), rest.clone()) else {
            return rest;
        };
        for tick in 0..ticks {
            if tick % 100 == 0 {
                progress("settling under gravity", tick, ticks);
            }
            simulation.advance(&Inputs::default());
            simulation.mesh_mut().change_motion(|_, _, v| *v *= 0.98);
        }
        progress("settling under gravity", ticks, ticks);
        simulation.mesh_mut().change_motion(|_, _, v| *v = Vec3::zeros());
        Snapshot { tick: 0, moved_for: 0, ..simulation.snapshot() }
    }

    /// The scene with every default written out.
    pub fn to_toml(&self) -> String {
        // Scenes hold nothing that TOML cannot say.
        toml::to_string(self).unwrap_or_default()
    }
}
