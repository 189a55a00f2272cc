//! What is simulated, for clients and for whoever opens a recording.

use crate::scene::Scene;
use crate::scene::tool_keys::{ToolKeys, ToolKind};
use palpate_core::contact::Shape;
use palpate_core::contact::jaws::Hinge;
use palpate_core::contact::obstacle::{Form, Obstacle};
use palpate_core::contact::shape::Part;
use palpate_core::contact::tool::MOST_TOOLS;
use palpate_core::math::Bounds;
use palpate_core::model::{Body, Organ};
use palpate_core::simulation::{TICK, TICKS_PER_FRAME};
use palpate_proto as proto;

/// A session of `scene` with `body`, whose tools nobody holds; who serves it, where and at what tick is left open.
pub fn describe(scene: &Scene, body: &Body) -> proto::Session {
    let material = body.material();
    let corners = |Bounds { low, high }: Bounds| low.iter().chain(high.iter()).copied().collect();
    proto::Session {
        version_major: proto::VERSION_MAJOR,
        version_minor: proto::VERSION_MINOR,
        frame: "world: right-handed, metres; gravity as the scene says".into(),
        tick_s: TICK,
        ticks_per_frame: TICKS_PER_FRAME as u32,
        body: Some(proto::BodyDescription {
            name: body.name().into(),
            levels: body.levels().len() as u32,
            nodes: body.levels().iter().map(|l| l.mesh.nodes.len() as u32).collect(),
            elements: body.levels().iter().map(|l| l.mesh.elements.len() as u32).collect(),
            mass_kg: body.mass(),
            density: material.density,
            youngs_modulus: material.youngs_modulus(),
            poisson_ratio: material.poisson_ratio(),
            bounds: corners(body.surface().bounds()),
            checksum: body.checksum(),
            organs: organs(body, &scene.shown_counts(body)),
        }),
        tools: (0..).zip(scene.tool.iter().take(MOST_TOOLS)).map(|(number, keys)| tool(number, keys)).collect(),
        obstacles: scene.settings().obstacles.iter().map(obstacle).collect(),
        limits: Some(proto::Limits {
            force: scene.safety.force_limit,
            torque: scene.safety.torque_limit,
            slew: scene.safety.slew_limit,
            tool_speed: scene.safety.tool_speed,
            workspace: corners(scene.workspace(body)),
        }),
        ..proto::Session::default()
    }
}

/// The organs of `body`, of each of which viewers are shown as many vertices and triangles as `counts` says.
pub fn organs(body: &Body, counts: &[[usize; 2]]) -> Vec<proto::Organ> {
    let organ = |(organ, [vertices, triangles]): (&Organ, &[usize; 2])| {
        let material = &body.parts().materials[usize::from(organ.material)];
        proto::Organ {
            name: organ.name.clone(),
            vertices: *vertices as u32,
            triangles: *triangles as u32,
            volume: body.surface().volume_within(organ.triangles.clone()),
            mass_kg: organ.mass,
            density: material.density,
            youngs_modulus: material.youngs_modulus(),
            poisson_ratio: material.poisson_ratio(),
        }
    };
    body.organs().iter().zip(counts).map(organ).collect()
}

fn tool(tool: u32, keys: &ToolKeys) -> proto::ToolDescription {
    let (kind, shape) = (keys.kind(), keys.shape());
    proto::ToolDescription {
        tool,
        name: keys.name.clone(),
        shape: kind.name().into(),
        radius: match kind {
            ToolKind::Convex | ToolKind::Compound | ToolKind::Plane => shape.bounding_radius(),
            ToolKind::Ball | ToolKind::Capsule | ToolKind::Cylinder => keys.radius,
        },
        length: match kind {
            ToolKind::Capsule | ToolKind::Cylinder => keys.length,
            ToolKind::Ball | ToolKind::Convex | ToolKind::Compound | ToolKind::Plane => 0.0,
        },
        taken: false,
        parts: parts(&shape),
        grip: shape.grip(),
    }
}

fn obstacle(obstacle: &Obstacle) -> proto::Obstacle {
    proto::Obstacle {
        name: obstacle.name.clone(),
        parts: match &obstacle.shape {
            Form::Ground => Vec::new(),
            Form::Parts(shape) => parts(shape),
        },
        position: obstacle.pose.position.iter().copied().collect(),
        orientation: obstacle.pose.orientation.to_vec(),
    }
}

fn parts(shape: &Shape) -> Vec<proto::ToolPart> {
    let part = |part: &Part| {
        let (corners, disc) = part.hull();
        proto::ToolPart {
            corners: corners.iter().flatten().copied().collect(),
            rounding: part.radius(),
            disc: disc.map_or(0.0, |(radius, _)| radius),
            axis: disc.map_or_else(Vec::new, |(_, axis)| axis.iter().copied().collect()),
            hinge: part.hinge().map(|Hinge { axis, point, closed, open }| proto::ToolHinge {
                axis: axis.iter().copied().collect(),
                point: point.iter().copied().collect(),
                closed: *closed,
                open: *open,
            }),
        }
    };
    shape.parts().iter().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::obstacle_keys::ObstacleKeys;

    fn described(toml: &str) -> proto::ToolDescription {
        tool(3, &toml::from_str(&format!("name = 'probe'\n{toml}")).unwrap())
    }

    #[test]
    fn every_shape_is_described_by_what_it_is_made_of() {
        let ball = described("radius = 0.01");
        assert_eq!((ball.tool, ball.name.as_str(), ball.shape.as_str()), (3, "probe", "ball"));
        let part =
            |corners: &[f64], rounding| proto::ToolPart { corners: corners.into(), rounding, ..Default::default() };
        assert_eq!(ball.parts, [part(&[0.0; 3], 0.01)]);
        let capsule = described("radius = 0.01\nlength = 0.1");
        assert_eq!((capsule.radius, capsule.length), (0.01, 0.1));
        assert_eq!(capsule.parts, [part(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.1], 0.01)]);
        let cylinder = described("shape = 'cylinder'\nradius = 0.01\nlength = 0.1\nrounding = 0.001");
        let ends = part(&[0.0, 0.0, 0.001, 0.0, 0.0, 0.1 - 0.001], 0.001);
        assert_eq!(cylinder.parts, [proto::ToolPart { disc: 0.01 - 0.001, axis: vec![0.0, 0.0, 1.0], ..ends }]);
        let points = "points = [[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.02]]";
        let convex = described(&format!("shape = 'convex'\nrounding = 0.001\n{points}"));
        assert_eq!((convex.parts[0].corners.len(), convex.parts[0].rounding), (12, 0.001));
        assert!(convex.radius > 0.02 && convex.parts[0].axis.is_empty());
    }

    #[test]
    fn obstacles_are_described_by_what_they_are_made_of_and_the_ground_by_its_frame() {
        let described = |toml: &str| {
            let keys: ObstacleKeys = toml::from_str(&format!("name = 'it'\n{toml}")).unwrap();
            obstacle(&keys.obstacle())
        };
        let wall = described("normal = [1.0, 0.0, 0.0]\nposition = [0.1, 0.0, 0.2]");
        assert!(wall.parts.is_empty() && wall.position == [0.1, 0.0, 0.2]);
        // The shortest turn from +z to +x: a quarter about +y.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let expected = [0.0, half, 0.0, half];
        assert!(wall.orientation.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{:?}", wall.orientation);
        let rib = described("shape = 'capsule'\nradius = 0.01\nlength = 0.1");
        assert_eq!((&rib.parts[0].corners[..], rib.parts[0].rounding), (&[0.0, 0.0, 0.0, 0.0, 0.0, 0.1][..], 0.01));
    }

    #[test]
    fn parts_of_a_compound_stand_where_they_are_in_the_tool() {
        let turned = "orientation = [0.0, 0.7071067811865476, 0.0, 0.7071067811865476]";
        let parts = format!(
            "[[part]]\nradius = 0.004\n[[part]]\nradius = 0.005\nlength = 0.1\nposition = [0.0, 0.02, 0.0]\n{turned}"
        );
        let forceps = described(&format!("shape = 'compound'\n{parts}"));
        assert_eq!(forceps.parts.len(), 2);
        // The quarter turn about +y lays the shaft along +x.
        let expected = [0.0, 0.02, 0.0, 0.1, 0.02, 0.0];
        let corners = &forceps.parts[1].corners;
        assert!(corners.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{corners:?}");
    }
}
