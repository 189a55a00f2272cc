//! Shapes made by formula: ellipsoids, organs of the belly and a toy, carved from implicit functions.
//!
//! Only `+ − × ÷ √` in f64 decide where a vertex lies, so a shape is the same on every x86-64 machine.

use super::soundness::check_closed;
use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use palpate_core::geometry::Surface;
use palpate_core::math::{Real, Vec3};

/// A sphere of `radius` [m] around the origin; `spacing` [m] between neighbouring vertices, kept between a fiftieth
/// and a third of the radius.
pub fn sphere_surface(radius: Real, spacing: Real) -> Surface {
    let spacing = within(spacing, radius / 50.0, radius / 3.0);
    extract(|p| p.norm() - radius, Vec3::repeat(-radius), Vec3::repeat(radius), spacing)
}

/// An ellipsoid with these diameters [m] around the origin; `spacing` [m] between neighbouring vertices, kept between a hundredth and a
/// sixth of the least diameter.
pub fn ellipsoid_surface(diameters: Vec3, spacing: Real) -> Surface {
    let (radii, least) = (diameters / 2.0, diameters.min());
    let spacing = within(spacing, least / 100.0, least / 6.0);
    extract(|p| ellipsoid(p, Vec3::zeros(), radii), -radii, radii, spacing)
}

/// A human-like liver: 0.20 m wide (x, its thin left lobe towards +x), 0.13 m deep (y, its front towards −y) and
/// 0.11 m high, standing on z = 0 under a dome, hollow below where the gallbladder lies.
///
/// `spacing` [m] between neighbouring vertices, kept between 1 mm and 8 mm. Closed, of one piece, without a handle.
pub fn liver_surface(spacing: Real) -> Surface {
    extract(liver, Vec3::new(-0.11, -0.075, -0.01), Vec3::new(0.11, 0.075, 0.12), within(spacing, 1e-3, 8e-3))
}

/// A human-like kidney: 0.11 m long (x), 0.06 m wide (y), 0.045 m thick, lying on z = 0, its hollow side towards −y.
///
/// `spacing` [m] between neighbouring vertices, kept between 1 mm and 5 mm. Closed, of one piece, without a handle.
pub fn kidney_surface(spacing: Real) -> Surface {
    extract(kidney, Vec3::new(-0.06, -0.035, -0.005), Vec3::new(0.06, 0.04, 0.05), within(spacing, 1e-3, 5e-3))
}

/// A human-like gallbladder: a pear 0.075 m long (y, its fundus towards −y, its neck towards +y) and 0.024 m thick around the origin.
///
/// `spacing` [m] between neighbouring vertices, kept between 0.5 mm and 2.5 mm. Closed, of one piece, without a handle.
pub fn gallbladder_surface(spacing: Real) -> Surface {
    let (low, high) = (Vec3::new(-0.014, -0.037, -0.014), Vec3::new(0.014, 0.043, 0.014));
    extract(gallbladder, low, high, within(spacing, 5e-4, 2.5e-3))
}

/// A human-like stomach, empty: bent, 0.10 m long (y), its fundus towards +y and wide, its pylorus towards −x and −y, around the origin.
///
/// `spacing` [m] between neighbouring vertices, kept between 1 mm and 5 mm. Closed, of one piece, without a handle.
pub fn stomach_surface(spacing: Real) -> Surface {
    let (low, high) = (Vec3::new(-0.06, -0.055, -0.03), Vec3::new(0.04, 0.06, 0.03));
    extract(stomach, low, high, within(spacing, 1e-3, 5e-3))
}

/// A toy creature with limbs that swing: round body, head, two ears, arms, legs and a tail, 0.20 m tall along z,
/// standing on z = 0 and looking towards −y.
///
/// `spacing` [m] between neighbouring vertices, kept between 1 mm and 6 mm. Closed, of one piece, without a handle.
pub fn toy_surface(spacing: Real) -> Surface {
    extract(toy, Vec3::new(-0.11, -0.07, -0.01), Vec3::new(0.11, 0.12, 0.22), within(spacing, 1e-3, 6e-3))
}

/// Signed function of the liver [m], negative inside.
fn liver(p: Vec3) -> Real {
    let right_lobe = ellipsoid(p, Vec3::new(-0.040, 0.001, 0.054), Vec3::new(0.060, 0.065, 0.056));
    let middle = ellipsoid(p, Vec3::new(0.008, -0.006, 0.066), Vec3::new(0.060, 0.054, 0.036));
    let left_lobe = ellipsoid(p, Vec3::new(0.052, -0.014, 0.074), Vec3::new(0.048, 0.042, 0.019));
    let organ = smooth_union(smooth_union(right_lobe, middle, 0.03), left_lobe, 0.03);
    // Stomach and bowel hollow the underside from the left and behind; the gallbladder digs a groove towards the front
    // edge, and between the lobes the round ligament notches that edge.
    let hollow = ellipsoid(p, Vec3::new(0.062, 0.010, -0.024), Vec3::new(0.118, 0.140, 0.084));
    let gallbladder = ellipsoid(p, Vec3::new(-0.008, -0.040, 0.030), Vec3::new(0.013, 0.040, 0.016));
    let ligament = ellipsoid(p, Vec3::new(0.038, -0.066, 0.054), Vec3::new(0.008, 0.018, 0.022));
    let organ = smooth_difference(organ, hollow, 0.014);
    smooth_difference(smooth_difference(organ, gallbladder, 0.014), ligament, 0.024)
}

/// Signed function of the kidney [m], negative inside.
fn kidney(p: Vec3) -> Real {
    let pole = |side: Real| ellipsoid(p, Vec3::new(side * 0.024, -0.003, 0.0225), Vec3::new(0.031, 0.026, 0.0225));
    let waist = ellipsoid(p, Vec3::new(0.0, 0.005, 0.0225), Vec3::new(0.040, 0.026, 0.0225));
    let organ = smooth_union(smooth_union(pole(-1.0), pole(1.0), 0.01), waist, 0.01);
    // Where its vessels enter.
    let hilum = ellipsoid(p, Vec3::new(0.0, -0.030, 0.0225), Vec3::new(0.014, 0.016, 0.018));
    smooth_difference(organ, hilum, 0.014)
}

/// Signed function of the gallbladder [m], negative inside.
fn gallbladder(p: Vec3) -> Real {
    let body = limb(p, Vec3::new(0.0, -0.022, 0.0), Vec3::new(0.0, 0.010, 0.0), 0.012, 0.010);
    let neck = limb(p, Vec3::new(0.0, 0.010, 0.0), Vec3::new(0.0, 0.037, 0.003), 0.010, 0.0045);
    smooth_union(body, neck, 0.004)
}

/// Signed function of the stomach [m], negative inside.
fn stomach(p: Vec3) -> Real {
    let (fundus, body) = (Vec3::new(0.010, 0.026, 0.0), Vec3::new(0.006, -0.014, 0.0));
    let upper = limb(p, fundus, body, 0.024, 0.020);
    let lower = limb(p, body, Vec3::new(-0.036, -0.032, -0.004), 0.020, 0.012);
    smooth_union(upper, lower, 0.012)
}

/// Signed function of the toy [m], negative inside.
fn toy(p: Vec3) -> Real {
    let join = |toy: Real, part: Real| smooth_union(toy, part, 0.012);
    let body = ellipsoid(p, Vec3::new(0.0, 0.0, 0.082), Vec3::new(0.044, 0.042, 0.046));
    let head = ellipsoid(p, Vec3::new(0.0, -0.004, 0.142), Vec3::new(0.037, 0.033, 0.031));
    let snout = ellipsoid(p, Vec3::new(0.0, -0.037, 0.135), Vec3::new(0.015, 0.013, 0.011));
    let tail = limb(p, Vec3::new(0.0, 0.035, 0.062), Vec3::new(0.0, 0.072, 0.066), 0.012, 0.012);
    let tail_tip = limb(p, Vec3::new(0.0, 0.072, 0.066), Vec3::new(0.0, 0.088, 0.096), 0.012, 0.015);
    let mut toy = [head, snout, smooth_union(tail, tail_tip, 0.004)].into_iter().fold(body, join);
    for side in [-1.0, 1.0] {
        let at = |x: Real, y: Real, z: Real| Vec3::new(side * x, y, z);
        let ear = limb(p, at(0.018, 0.0, 0.160), at(0.034, 0.004, 0.184), 0.012, 0.016);
        let arm = limb(p, at(0.034, -0.004, 0.100), at(0.084, -0.022, 0.113), 0.012, 0.016);
        let leg = limb(p, at(0.024, 0.0, 0.048), at(0.034, 0.002, 0.018), 0.021, 0.018);
        // Its middle is above the soles.
        let foot = limb(p, at(0.036, 0.022, 0.017), at(0.038, -0.026, 0.017), 0.017, 0.017);
        toy = [ear, arm, smooth_union(leg, foot, 0.004)].into_iter().fold(toy, join);
    }
    toy
}

/// Signed function of an ellipsoid [m]: its zero is exact and its slope there is one, which is all the projection asks.
fn ellipsoid(p: Vec3, centre: Vec3, radii: Vec3) -> Real {
    let scaled = (p - centre).component_div(&radii);
    let length = scaled.norm();
    let slope = scaled.component_div(&radii).norm();
    // At the very centre the quotient has no limit; any negative value will do.
    if slope > 0.0 { length * (length - 1.0) / slope } else { -radii.min() }
}

/// Signed distance [m] to a rounded limb from `a` to `b`, its radius going from `radius_a` to `radius_b`.
fn limb(p: Vec3, a: Vec3, b: Vec3, radius_a: Real, radius_b: Real) -> Real {
    let along = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
    (p - a - (b - a) * along).norm() - (radius_a + (radius_b - radius_a) * along)
}

/// Smaller of two signed functions, blended by a cubic where they differ by less than `blend` [m].
fn smooth_union(a: Real, b: Real, blend: Real) -> Real {
    let h = (blend - (a - b).abs()).max(0.0) / blend;
    a.min(b) - h * h * h * blend / 6.0
}

/// What is in `a` but not in `b`, the rim rounded over `blend` [m].
fn smooth_difference(a: Real, b: Real, blend: Real) -> Real {
    -smooth_union(-a, b, blend)
}

/// `x` kept between `low` and `high`; `low` for NaN.
fn within(x: Real, low: Real, high: Real) -> Real {
    x.max(low).min(high)
}

/// Grids tried for one shape. At coarse spacings one in five cuts the toy badly; sixteen failed in none of 250 trials.
const GRIDS: u32 = 16;
/// Rounds in which vertices move towards the middle of their neighbours; six leave an angle below 30° in less than one
/// triangle of a hundred.
const RELAXATION_ROUNDS: usize = 6;

/// The zero surface of `signed` [m, negative inside] in the box from `low` to `high` [m]: one closed piece without a
/// handle, facing outward.
///
/// Surface nets on a grid of `spacing` [m] give the triangles, in f32. Then the vertices spread evenly and are brought
/// onto the surface by Newton steps along the gradient.
fn extract(signed: impl Fn(Vec3) -> Real, low: Vec3, high: Vec3, spacing: Real) -> Surface {
    let mut surface = Surface::default();
    for grid in 0..GRIDS {
        // A cell whose corners are inside and outside crosswise joins two sheets of surface in one vertex or edge.
        // Whether there is one depends on where the grid happens to lie, so try another place.
        let shift = Vec3::new(0.9, 0.6, 0.3) * (Real::from(grid + 1) / Real::from(GRIDS));
        surface = nets(&signed, low - (shift + Vec3::repeat(1.0)) * spacing, high, spacing);
        let without_handle = surface.vertices.len() == surface.triangles.len() / 2 + 2;
        if without_handle && check_closed(&mut surface).is_ok() {
            break;
        }
    }
    for _ in 0..RELAXATION_ROUNDS {
        let mut sums = vec![(Vec3::zeros(), 0.0); surface.vertices.len()];
        for triangle in &surface.triangles {
            for i in 0..3 {
                let sum = &mut sums[triangle[i] as usize];
                sum.0 += surface.vertices[triangle[(i + 1) % 3] as usize];
                sum.1 += 1.0;
            }
        }
        for (p, (sum, n_neighbours)) in surface.vertices.iter_mut().zip(sums) {
            *p += 0.5 * (sum / n_neighbours - *p);
            for _ in 0..3 {
                *p -= newton_step(&signed, *p, spacing);
            }
        }
    }
    surface
}

/// The surface nets of `signed` on the grid of `spacing` [m] that begins at `origin` and reaches beyond `high` [m].
fn nets(signed: impl Fn(Vec3) -> Real, origin: Vec3, high: Vec3, spacing: Real) -> Surface {
    // The nets close only around grid points that are outside, so one layer lies beyond.
    let size = ((high - origin) / spacing).map(|n| n.ceil() as u32 + 2);
    let grid = RuntimeShape::<u32, 3>::new([size.x, size.y, size.z]);
    let place = |p: [Real; 3]| origin + Vec3::from(p) * spacing;
    let values: Vec<f32> =
        (0..grid.size()).map(|i| (signed(place(grid.delinearize(i).map(Real::from))) / spacing) as f32).collect();
    let mut buffer = SurfaceNetsBuffer::default();
    surface_nets(&values, &grid, [0; 3], [size.x - 1, size.y - 1, size.z - 1], &mut buffer);
    Surface {
        vertices: buffer.positions.iter().map(|p| place(p.map(Real::from))).collect(),
        triangles: buffer.indices.as_chunks::<3>().0.to_vec(),
    }
}

/// Step [m] from the zero of `signed` to `p`, along the central-difference gradient and at most half a `spacing` long.
fn newton_step(signed: impl Fn(Vec3) -> Real, p: Vec3, spacing: Real) -> Vec3 {
    let h = 1e-3 * spacing;
    let slope = |axis: Vec3| (signed(p + axis * h) - signed(p - axis * h)) / (2.0 * h);
    let gradient = Vec3::new(slope(Vec3::x()), slope(Vec3::y()), slope(Vec3::z()));
    let step = gradient * (signed(p) / gradient.norm_squared().max(1e-6));
    step * (0.5 * spacing / step.norm().max(0.5 * spacing))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::geometry::primitives::box_surface;
    use palpate_core::math::Bounds;

    /// Vertices − edges + faces: 2 for a closed surface without a handle.
    fn euler_characteristic(surface: &Surface) -> isize {
        surface.vertices.len() as isize - surface.triangles.len() as isize / 2
    }

    fn pieces(surface: &Surface) -> usize {
        let mut root: Vec<usize> = (0..surface.vertices.len()).collect();
        fn find(root: &[usize], mut v: usize) -> usize {
            while root[v] != v {
                v = root[v];
            }
            v
        }
        for t in &surface.triangles {
            for v in &t[1..] {
                let (a, b) = (find(&root, t[0] as usize), find(&root, *v as usize));
                root[a.max(b)] = a.min(b);
            }
        }
        (0..root.len()).filter(|&v| root[v] == v).count()
    }

    fn is_one_piece_without_handles(name: &str, surface: &Surface) {
        let mut checked = surface.clone();
        check_closed(&mut checked).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(&checked, surface, "{name} faces outward");
        assert_eq!(euler_characteristic(surface), 2, "{name}");
        assert_eq!(pieces(surface), 1, "{name}");
    }

    /// Every triangle faces along the gradient of the function it was carved from.
    fn has_no_fold(name: &str, surface: &Surface, signed: impl Fn(Vec3) -> Real) {
        for t in 0..surface.triangles.len() {
            let [a, b, c] = surface.corners(t);
            let normal = (b - a).cross(&(c - a)).normalize();
            let (centre, h) = ((a + b + c) / 3.0, 1e-5);
            let rise = signed(centre + normal * h) - signed(centre - normal * h);
            assert!(rise > 0.0, "{name}: triangle {t} at {centre:?} is folded");
        }
    }

    #[test]
    fn a_box_surface_is_closed_and_encloses_the_box() {
        let surface = box_surface(Vec3::new(0.1, 0.2, 0.3), [2, 3, 4]);
        is_one_piece_without_handles("box", &surface);
        assert!((surface.volume() - 0.006).abs() < 1e-17);
        assert_eq!(surface.bounds(), Bounds::new(Vec3::zeros(), Vec3::new(0.1, 0.2, 0.3)));
    }

    #[test]
    fn the_vertices_of_a_sphere_lie_on_it() {
        let sphere = sphere_surface(0.05, 0.004);
        is_one_piece_without_handles("sphere", &sphere);
        assert!(sphere.vertices.iter().all(|p| (p.norm() - 0.05).abs() < 1e-12));
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.05f64.powi(3);
        assert!((sphere.volume() / exact - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_liver_is_one_closed_piece_of_the_stated_size_at_every_spacing() {
        for spacing in [0.002, 0.003, 0.004, 0.005, 0.006, 0.008] {
            let surface = liver_surface(spacing);
            is_one_piece_without_handles("liver", &surface);
            has_no_fold("liver", &surface, liver);
            let Bounds { low, high } = surface.bounds();
            let size = high - low;
            assert!((size - Vec3::new(0.20, 0.13, 0.11)).amax() < 0.006, "{spacing}: {size:?}");
            assert!(low.z.abs() < 0.002 && (low.x + high.x).abs() < 0.008, "{low:?} {high:?}");
        }
    }

    #[test]
    fn the_kidney_is_one_closed_piece_of_the_stated_size_at_every_spacing() {
        for spacing in [0.001, 0.002, 0.003, 0.004, 0.005] {
            let surface = kidney_surface(spacing);
            is_one_piece_without_handles("kidney", &surface);
            has_no_fold("kidney", &surface, kidney);
            let Bounds { low, high } = surface.bounds();
            let size = high - low;
            assert!((size - Vec3::new(0.11, 0.06, 0.045)).amax() < 0.006, "{spacing}: {size:?}");
            assert!(low.z.abs() < 1e-3, "{spacing}: stands on {}", low.z);
        }
    }

    #[test]
    fn the_gallbladder_and_the_stomach_are_closed_pieces_of_the_stated_size_at_every_spacing() {
        for (i, spacing) in [0.001, 0.0015, 0.002, 0.0025].into_iter().enumerate() {
            let surface = gallbladder_surface(spacing);
            is_one_piece_without_handles("gallbladder", &surface);
            has_no_fold("gallbladder", &surface, gallbladder);
            let size = surface.bounds().size();
            assert!((size - Vec3::new(0.024, 0.075, 0.024)).amax() < 0.002, "{spacing}: {size:?}");
            let spacing = [0.002, 0.003, 0.004, 0.005][i];
            let surface = stomach_surface(spacing);
            is_one_piece_without_handles("stomach", &surface);
            has_no_fold("stomach", &surface, stomach);
            let size = surface.bounds().size();
            assert!((size - Vec3::new(0.082, 0.094, 0.048)).amax() < 0.004, "{spacing}: {size:?}");
        }
    }

    #[test]
    fn an_ellipsoid_has_the_asked_diameters() {
        for diameters in [Vec3::repeat(0.06), Vec3::new(0.2, 0.1, 0.05)] {
            let surface = ellipsoid_surface(diameters, 0.003);
            is_one_piece_without_handles("ellipsoid", &surface);
            assert!((surface.bounds().size() - diameters).amax() < 0.001, "{:?}", surface.bounds());
            let exact = std::f64::consts::PI / 6.0 * diameters.x * diameters.y * diameters.z;
            assert!((surface.volume() / exact - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn the_toy_is_one_closed_piece_of_the_stated_size_at_every_spacing() {
        for spacing in [0.002, 0.003, 0.004, 0.005, 0.006] {
            let surface = toy_surface(spacing);
            is_one_piece_without_handles("toy", &surface);
            has_no_fold("toy", &surface, toy);
            let Bounds { low, high } = surface.bounds();
            assert!(low.z.abs() < 0.002 && (high.z - 0.2).abs() < 0.004, "{low:?} {high:?}");
        }
    }

    #[test]
    fn a_finer_spacing_changes_the_resolution_and_not_the_shape() {
        for shape in [liver_surface, toy_surface] {
            let (coarse, fine) = (shape(0.006), shape(0.003));
            assert!(fine.vertices.len() > 3 * coarse.vertices.len());
            assert!((coarse.volume() / fine.volume() - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn a_sphere_without_extent_is_an_empty_surface() {
        for radius in [0.0, -1.0, Real::NAN, Real::INFINITY] {
            assert!(sphere_surface(radius, 0.1).triangles.is_empty(), "{radius}");
        }
    }

    #[test]
    fn a_spacing_that_is_no_number_gives_the_finest_shape() {
        assert_eq!(sphere_surface(0.01, Real::NAN), sphere_surface(0.01, 0.0));
    }
}
