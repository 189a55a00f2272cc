//! What cutting the triangles of a surface leaves as it is.

use palpate_body::geometry::soundness::check_closed;
use palpate_core::geometry::Surface;
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::{Real, Vec3};

#[test]
fn a_refined_surface_is_the_same_one_closed_with_its_long_edges_cut() {
    let whole = box_surface(Vec3::new(0.1, 0.01, 0.01), [1, 1, 1]);
    let mut fine = whole.refined(400, 0.003);
    check_closed(&mut fine).unwrap();
    assert!((fine.volume() / whole.volume() - 1.0).abs() < 1e-12);
    assert!((300..=400).contains(&fine.vertices.len()), "{}", fine.vertices.len());
    let longest = |s: &Surface| {
        let edges = s.triangles.iter().flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]);
        edges.map(|[a, b]| (s.vertices[*a as usize] - s.vertices[*b as usize]).norm()).fold(0.0, Real::max)
    };
    assert!(longest(&fine) < 0.01, "{}", longest(&fine));
    assert!(longest(&whole.refined(5_000, 0.003)) <= 0.003);
    assert_eq!(whole.refined(8, 0.0), whole);
}

#[test]
fn a_subdivided_surface_is_the_same_one_in_smaller_triangles() {
    let whole = box_surface(Vec3::new(0.1, 0.2, 0.3), [1, 2, 3]);
    for parts in 1..6 {
        let mut fine = whole.subdivided(parts);
        assert_eq!(fine.triangles.len(), whole.triangles.len() * (parts * parts) as usize);
        // A closed surface without handles has two vertices more than half as many as triangles.
        assert_eq!(fine.vertices.len(), fine.triangles.len() / 2 + 2);
        check_closed(&mut fine).unwrap();
        assert!((fine.volume() / whole.volume() - 1.0).abs() < 1e-12);
        assert_eq!(fine.vertices[..whole.vertices.len()], whole.vertices);
    }
}
