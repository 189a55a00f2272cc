//! What a tool looks like: the skin of each of its parts, in the tool's own frame.

use palpate_sdk::ToolDescription;
use palpate_sdk::proto::{ToolHinge, ToolPart};
use std::f32::consts::{PI, TAU};
use three_d::{InnerSpace, Quat, Rad, Rotation, Rotation3, Vec3, vec3};

/// Steps from pole to pole of a part, and around it; even, so that boxes have their faces.
const RINGS: u32 = 24;
const SECTORS: u32 = 48;

/// A tool's shape.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolShape {
    /// Of the part that touches, or of the ball that holds the whole [m].
    pub radius: f32,
    /// Its parts.
    pub skins: Vec<Skin>,
}

/// The skin of a convex part: for each direction of a grid around it, the point that lies farthest in that direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    /// [m].
    pub points: Vec<Vec3>,
    /// (points) unit, outwards.
    pub normals: Vec<Vec3>,
    /// What it turns about as the tool's jaws open.
    pub hinge: Option<Hinge>,
}

/// What a part turns about, in the tool's own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// Unit vector.
    axis: Vec3,
    /// A place of the axis [m].
    point: Vec3,
    /// Angles of closed and of open jaws [rad].
    angles: [f32; 2],
}

impl ToolShape {
    /// As `description` has it; parts that make no sense are left out, and without any it is a ball.
    pub fn new(description: &ToolDescription) -> Self {
        let ball = ToolPart { corners: vec![0.0; 3], rounding: description.radius, ..Default::default() };
        let mut skins = Skin::all(&description.parts);
        if skins.is_empty() {
            skins.extend(Skin::of(&ball));
        }
        Self { radius: description.radius as f32, skins }
    }

    /// Distance [m] from the shape with its jaws open by `opening` to `point` in the tool's own frame, negative inside. Beside an
    /// edge it may be too small by a twentieth of the edge's length.
    pub fn distance(&self, point: Vec3, opening: f32) -> f32 {
        let of = |skin: &Skin| {
            let (moved, turn) = skin.turned(opening);
            skin.distance(turn.conjugate().rotate_vector(point - moved))
        };
        self.skins.iter().map(of).fold(f32::INFINITY, f32::min)
    }

    /// Radius of the ball around the reference point that holds it [m].
    pub fn reach(&self) -> f32 {
        let farthest = |skin: &Skin| {
            let hinge = skin.hinge.map_or(vec3(0.0, 0.0, 0.0), |hinge| hinge.point);
            hinge.magnitude() + skin.points.iter().map(|point| (point - hinge).magnitude()).fold(0.0, f32::max)
        };
        self.skins.iter().map(farthest).fold(0.0, f32::max)
    }
}

impl Hinge {
    /// `None` where it makes no sense.
    fn of(hinge: &ToolHinge) -> Option<Self> {
        let vector = |v: &[f64]| v.first_chunk().map(|[x, y, z]| vec3(*x as f32, *y as f32, *z as f32));
        let (axis, point) = (vector(&hinge.axis)?, vector(&hinge.point)?);
        let angles = [hinge.closed as f32, hinge.open as f32];
        let numbers = [axis.x, axis.y, axis.z, point.x, point.y, point.z, angles[0], angles[1]];
        (axis.magnitude2() > 0.0 && numbers.iter().all(|x| x.is_finite())).then(|| Self {
            axis: axis.normalize(),
            point,
            angles,
        })
    }
}

impl Skin {
    /// Triangles between its points: corners, counter-clockwise from outside.
    pub fn triangles() -> Vec<u32> {
        let corners = |cell: u32| {
            let (ring, sector) = (cell / SECTORS, cell % SECTORS);
            let at = move |ring: u32, sector: u32| ring * SECTORS + sector % SECTORS;
            let [a, b, c, d] = [at(ring, sector), at(ring + 1, sector), at(ring + 1, sector + 1), at(ring, sector + 1)];
            [a, b, c, a, c, d]
        };
        (0..RINGS * SECTORS).flat_map(corners).collect()
    }

    /// How it is moved [m] and turned in the tool's own frame where the jaws are open by `opening`.
    pub fn turned(&self, opening: f32) -> (Vec3, Quat) {
        let Some(Hinge { axis, point, angles: [closed, open] }) = self.hinge else {
            return (vec3(0.0, 0.0, 0.0), Quat::new(1.0, 0.0, 0.0, 0.0));
        };
        let turn = Quat::from_axis_angle(axis, Rad(closed + opening * (open - closed)));
        (point - turn.rotate_vector(point), turn)
    }

    /// Those of `parts` that make sense.
    pub fn all(parts: &[ToolPart]) -> Vec<Self> {
        parts.iter().filter_map(Skin::of).collect()
    }

    fn of(part: &ToolPart) -> Option<Self> {
        let vector = |v: &[f64; 3]| vec3(v[0] as f32, v[1] as f32, v[2] as f32);
        let corners: Vec<Vec3> = part.corners.as_chunks().0.iter().map(vector).collect();
        let (rounding, disc) = (part.rounding as f32, part.disc as f32);
        let pole = part.axis.first_chunk().map_or(Vec3::unit_z(), vector);
        let numbers = corners.iter().chain([&pole]).flat_map(|v| [v.x, v.y, v.z]).chain([rounding, disc]);
        if corners.is_empty() || pole.magnitude2() == 0.0 || !numbers.into_iter().all(f32::is_finite) {
            return None;
        }
        let pole = pole.normalize();
        let aside = if pole.x.abs() < 0.9 { Vec3::unit_x() } else { Vec3::unit_y() };
        let east = (aside - pole * aside.dot(pole)).normalize();
        let north = pole.cross(east);
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        for (ring, sector) in (0..=RINGS).flat_map(|ring| (0..SECTORS).map(move |sector| (ring, sector))) {
            let (down, around) = (PI * ring as f32 / RINGS as f32, TAU * sector as f32 / SECTORS as f32);
            let across = around.cos() * east + around.sin() * north;
            // All of a pole's points are one, or a flat end, of which every corner is as far, would be folded.
            let (sine, rim) = if ring == 0 || ring == RINGS { (0.0, 0.0) } else { (down.sin(), disc) };
            let normal = sine * across + down.cos() * pole;
            let farthest = |a: Vec3, b: &Vec3| if b.dot(normal) > a.dot(normal) { *b } else { a };
            let corner = corners.iter().fold(corners[0], farthest);
            points.push(corner + rim * across + rounding * normal);
            normals.push(normal);
        }
        Some(Self { points, normals, hinge: part.hinge.as_ref().and_then(Hinge::of) })
    }

    /// Of two convex bodies there is a plane between: the farthest of those that touch this one.
    fn distance(&self, point: Vec3) -> f32 {
        let heights = self.points.iter().zip(&self.normals).map(|(skin, normal)| normal.dot(point - skin));
        heights.fold(f32::NEG_INFINITY, f32::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A shape of one part: `corners` (n, 3) [m], `rounding` and `disc` [m].
    fn shape(corners: &[f64], rounding: f64, disc: f64) -> ToolShape {
        let axis = if disc > 0.0 { vec![0.0, 0.0, 1.0] } else { vec![] };
        let part = ToolPart { corners: corners.into(), rounding, disc, axis, hinge: None };
        ToolShape::new(&ToolDescription { parts: vec![part], ..Default::default() })
    }

    fn is(distance: f32, expected: f32) -> bool {
        (distance - expected).abs() < 2e-4
    }

    /// Volume that the mesh encloses [m³]: negative where it is inside out.
    fn volume(shape: &ToolShape) -> f32 {
        let of = |skin: &Skin, t: &[u32; 3]| {
            let [a, b, c] = t.map(|corner| skin.points[corner as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        let of_skin = |skin: &Skin| Skin::triangles().as_chunks().0.iter().map(|t| of(skin, t)).sum::<f32>();
        shape.skins.iter().map(of_skin).sum()
    }

    #[test]
    fn balls_capsules_and_cylinders_are_where_they_should_be() {
        let ball = shape(&[0.0; 3], 0.01, 0.0);
        assert!(
            is(ball.distance(vec3(0.0, 0.015, 0.0), 0.0), 0.005)
                && is(ball.distance(vec3(0.0, 0.0, 0.004), 0.0), -0.006)
        );
        let capsule = shape(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.1], 0.01, 0.0);
        assert!(is(capsule.distance(vec3(0.012, 0.0, 0.05), 0.0), 0.002));
        assert!(is(capsule.distance(vec3(0.0, 0.0, 0.12), 0.0), 0.01));
        let cylinder = shape(&[0.0, 0.0, 0.001, 0.0, 0.0, 0.099], 0.001, 0.009);
        assert!(is(cylinder.distance(vec3(0.0, -0.012, 0.05), 0.0), 0.002));
        assert!(is(cylinder.distance(vec3(0.0, 0.0, -0.003), 0.0), 0.003));
        let full = [PI * 1e-6 * 4.0 / 3.0, PI * 1e-4 * 0.1 + PI * 1e-6 * 4.0 / 3.0, PI * 1e-4 * 0.1];
        for (shape, full) in [ball, capsule, cylinder].iter().zip(full) {
            assert!((volume(shape) / full - 1.0).abs() < 0.04, "{} of {full}", volume(shape));
        }
    }

    #[test]
    fn a_box_has_flat_faces_and_a_compound_has_room_between_its_parts() {
        let corner =
            |i: u32| [0.02, 0.01, 0.005].into_iter().zip(0..).map(move |(x, c)| if i >> c & 1 == 1 { x } else { -x });
        let corners: Vec<f64> = (0..8).flat_map(corner).collect();
        let slab = shape(&corners, 0.0005, 0.0);
        assert!(
            is(slab.distance(vec3(0.0, 0.0, 0.0075), 0.0), 0.002)
                && is(slab.distance(vec3(0.0, -0.0125, 0.0), 0.0), 0.002)
        );
        assert!(volume(&slab) > 0.04 * 0.02 * 0.01, "{}", volume(&slab));
        let two = [-0.02, 0.02].map(|x| ToolPart { corners: vec![x, 0.0, 0.0], rounding: 0.005, ..Default::default() });
        let two = ToolShape::new(&ToolDescription { parts: two.into(), ..Default::default() });
        assert!(is(two.distance(vec3(0.0, 0.0, 0.0), 0.0), 0.015) && two.distance(vec3(0.021, 0.0, 0.0), 0.0) < 0.0);
        assert!((volume(&two) / (2.0 * PI * 1.25e-7 * 4.0 / 3.0) - 1.0).abs() < 0.04);
    }

    #[test]
    fn a_jaw_turns_about_its_hinge_as_it_opens() {
        let (axis, point) = (vec![0.0, 1.0, 0.0], vec![0.0, 0.0, 0.1]);
        let hinge = Some(ToolHinge { axis, point, closed: 0.0, open: f64::from(PI / 2.0) });
        let jaw = ToolPart { corners: vec![0.0; 3], rounding: 0.01, hinge, ..Default::default() };
        let tool = ToolShape::new(&ToolDescription { parts: vec![jaw], ..Default::default() });
        // A quarter of a turn about +y takes what hangs down to -x.
        for (opening, place) in [(0.0, vec3(0.0, 0.0, 0.0)), (1.0, vec3(-0.1, 0.0, 0.1))] {
            assert!(is(tool.distance(place, opening), -0.01), "{}", tool.distance(place, opening));
        }
        assert!(is(tool.reach(), 0.21));
    }

    #[test]
    fn a_part_that_makes_no_sense_is_left_out_and_a_tool_without_any_is_a_ball() {
        let ball = ToolPart { corners: vec![0.0; 3], rounding: 0.02, ..Default::default() };
        for corners in [vec![], vec![0.0, f64::NAN, 0.0]] {
            let senseless = ToolPart { corners, rounding: 0.01, ..Default::default() };
            let parts = vec![senseless, ball.clone()];
            assert_eq!(ToolShape::new(&ToolDescription { parts, ..Default::default() }).skins.len(), 1);
        }
        let plain = ToolShape::new(&ToolDescription { radius: 0.02, ..Default::default() });
        assert_eq!(Some(&plain.skins[0]), Skin::of(&ball).as_ref());
    }
}
