//! Shapes that need no file: the bundled organs and the toy, and ellipsoids.

use super::body_keys::{BodyKeys, Source};
use palpate_body::geometry::primitives;
use palpate_core::geometry::Surface;
use palpate_core::math::{Real, Vec3};

/// The closed surface that `keys` name, unscaled; `None` where it is no such shape.
pub(super) fn by_formula(keys: &BodyKeys) -> Option<Surface> {
    // A surface net at this spacing has about as many vertices as asked for (area over spacing squared).
    let spacing = |area: Real| (area / keys.display_vertices as Real).sqrt();
    let size = Vec3::from(keys.size);
    Some(match keys.source {
        Source::Liver => primitives::liver_surface(spacing(LIVER_AREA)),
        Source::Kidney => primitives::kidney_surface(spacing(KIDNEY_AREA)),
        Source::Gallbladder => primitives::gallbladder_surface(spacing(GALLBLADDER_AREA)),
        Source::Stomach => primitives::stomach_surface(spacing(STOMACH_AREA)),
        Source::Toy => primitives::toy_surface(spacing(TOY_AREA)),
        Source::Ellipsoid => primitives::ellipsoid_surface(size, spacing(ellipsoid_area(size))),
        Source::Box | Source::Surface | Source::Volumes | Source::Prepared => return None,
    })
}

/// Areas of the bundled shapes [m²], of their surfaces: they turn a vertex count into a spacing. With others there are more or fewer
/// vertices than were asked for.
const LIVER_AREA: Real = 0.070;
const KIDNEY_AREA: Real = 0.018;
const GALLBLADDER_AREA: Real = 0.0047;
const STOMACH_AREA: Real = 0.0155;
const TOY_AREA: Real = 0.060;

/// About that of an ellipsoid with these diameters [m²]: of a ball with the mean of the products of two of its radii for the square of its
/// radius, which is right for a ball, a seventh too little for a needle and a third for a disc.
fn ellipsoid_area(diameters: Vec3) -> Real {
    let [a, b, c] = (diameters / 2.0).into();
    4.0 * std::f64::consts::PI * (a * b + b * c + c * a) / 3.0
}
