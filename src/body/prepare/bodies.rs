//! The bodies in a file: the one that is meant, its cavities, and specks beside it.

use super::shape_fault::{ShapeFault, across};
use crate::geometry::LabelledMesh;
use crate::geometry::mesh_io::Solid;
use crate::geometry::pieces::Groups;
use palpate_core::geometry::surface::keep_referenced;
use palpate_core::geometry::{Surface, TetMesh};
use palpate_core::math::{Bounds, Real, Vec3, to_parry};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

/// Diagonal of the box around a speck over the finest elements (no unit, tuned): no lattice shows so small a piece. With
/// less, dust of a scan is refused as a second body; with more, pieces that elements show would be dropped.
const SPECK: Real = 0.5;

/// A body in a file: a piece of its own, with its cavities.
struct FoundBody {
    /// Numbers of its cells, of its cavities, too.
    cells: Vec<u32>,
    /// Without its cavities [m³].
    volume: Real,
    bounds: Bounds,
    /// A point of it.
    corner: Vec3,
}

impl FoundBody {
    /// The diagonal of the box around it [m].
    fn size(&self) -> Real {
        self.bounds.size().norm()
    }
}

/// `solid` without specks, pieces far smaller than `element` [m] beside its largest body; with `only_largest`, without any
/// other body. And what was dropped, in words.
///
/// # Errors
/// When another body is left.
pub fn one_body(solid: Solid, element: Real, only_largest: bool) -> Result<(Solid, Option<String>), ShapeFault> {
    let mut bodies = found(&solid);
    if bodies.len() < 2 {
        return Ok((solid, None));
    }
    let others = bodies.split_off(1);
    let is_speck = |body: &FoundBody| body.size() < SPECK * element;
    let (specks, real): (Vec<FoundBody>, Vec<FoundBody>) = others.into_iter().partition(is_speck);
    if !real.is_empty() && !only_largest {
        return Err(several(&solid, &bodies[0], &real));
    }
    let said: Vec<String> = [(&specks, "specks"), (&real, "other bodies")]
        .into_iter()
        .filter(|(dropped, _)| !dropped.is_empty())
        .map(|(dropped, what)| {
            let size = dropped.iter().map(FoundBody::size).fold(0.0, Real::max);
            format!("{} {what} dropped, the largest {} across", dropped.len(), across(size))
        })
        .collect();
    let mut kept = std::mem::take(&mut bodies[0].cells);
    kept.sort_unstable();
    Ok((of_cells(solid, &kept), Some(said.join(", "))))
}

/// Refuses `solid` where it is several bodies, however small.
///
/// # Errors
/// When it is.
pub(super) fn check_one_body(solid: &Solid) -> Result<(), ShapeFault> {
    match found(solid).as_slice() {
        [first, others @ ..] if !others.is_empty() => Err(several(solid, first, others)),
        _ => Ok(()),
    }
}

fn several(solid: &Solid, first: &FoundBody, others: &[FoundBody]) -> ShapeFault {
    let second = &others[0];
    let within = match solid {
        Solid::Surface(surface) => first.bounds.contains(&second.corner) && is_within(surface, first, second.corner),
        Solid::Volume(_) => false,
    };
    let sizes = [first.size(), second.size()];
    let [first, second] = [first.bounds.middle(), second.bounds.middle()];
    ShapeFault::SeveralBodies { count: 1 + others.len(), sizes, first, second, within }
}

/// The bodies that `solid` holds, the largest first.
fn found(solid: &Solid) -> Vec<FoundBody> {
    let mut bodies = match solid {
        Solid::Surface(surface) => of_surface(surface),
        Solid::Volume(LabelledMesh { mesh, .. }) => of_mesh(mesh),
    };
    bodies.sort_by(|a, b| b.volume.abs().total_cmp(&a.volume.abs()));
    bodies
}

/// The cells of each of the groups, whose number each cell bears.
fn by_group(group_of: &[u32]) -> Vec<Vec<u32>> {
    let mut cells: Vec<u32> = (0..group_of.len() as u32).collect();
    cells.sort_by_key(|cell| group_of[*cell as usize]);
    cells.chunk_by(|a, b| group_of[*a as usize] == group_of[*b as usize]).map(<[u32]>::to_vec).collect()
}

/// Pieces that hang together by nodes.
fn of_mesh(mesh: &TetMesh) -> Vec<FoundBody> {
    let mut groups = Groups::new(mesh.nodes.len());
    for [a, rest @ ..] in &mesh.elements {
        rest.iter().for_each(|n| _ = groups.join(*a, *n));
    }
    let group_of: Vec<u32> = mesh.elements.iter().map(|e| groups.of(e[0])).collect();
    let body = |cells: Vec<u32>| FoundBody {
        volume: cells.iter().map(|e| mesh.volume(*e as usize)).sum(),
        bounds: Bounds::of(cells.iter().flat_map(|e| mesh.corners(*e as usize))),
        corner: mesh.corners(cells[0] as usize)[0],
        cells,
    };
    by_group(&group_of).into_iter().map(body).collect()
}

/// Shells of triangles that hang together by edges, those that only touch in a point apart, each with the cavities in it:
/// shells that face inward, and no smaller shell that faces outward is around them.
fn of_surface(surface: &Surface) -> Vec<FoundBody> {
    let edges = |(t, &[a, b, c]): (usize, &[u32; 3])| {
        [[a, b], [b, c], [c, a]].map(|[from, to]| ([from.min(to), from.max(to)], t as u32))
    };
    let mut edges: Vec<([u32; 2], u32)> = surface.triangles.iter().enumerate().flat_map(edges).collect();
    edges.sort_unstable();
    let mut groups = Groups::new(surface.triangles.len());
    edges.windows(2).filter(|pair| pair[0].0 == pair[1].0).for_each(|pair| _ = groups.join(pair[0].1, pair[1].1));
    let group_of: Vec<u32> = (0..surface.triangles.len() as u32).map(|t| groups.of(t)).collect();
    let shell = |cells: Vec<u32>| {
        let corner = surface.corners(cells[0] as usize)[0];
        let part = |t: &u32| {
            let [a, b, c] = surface.corners(*t as usize).map(|p| p - corner);
            a.dot(&b.cross(&c)) / 6.0
        };
        let bounds = Bounds::of(cells.iter().flat_map(|t| surface.corners(*t as usize)));
        FoundBody { volume: cells.iter().map(part).sum(), bounds, corner, cells }
    };
    let (inward, mut outward): (Vec<FoundBody>, Vec<FoundBody>) =
        by_group(&group_of).into_iter().map(shell).partition(|shell| shell.volume < 0.0);
    outward.sort_by(|a, b| a.volume.total_cmp(&b.volume));
    // Only where there is a cavity to place is a shell made ready for questions.
    let mut around: Vec<Option<TriMesh>> = vec![None; outward.len()];
    let mut homeless = Vec::new();
    let mut cavities: Vec<Vec<u32>> = vec![Vec::new(); outward.len()];
    for cavity in inward {
        let home = (0..outward.len()).find(|i| {
            outward[*i].bounds.contains(&cavity.corner) && {
                let around = around[*i].get_or_insert_with(|| alone(surface, &outward[*i].cells).to_trimesh());
                around.project_local_point(to_parry(cavity.corner), false).is_inside
            }
        });
        match home {
            Some(home) => cavities[home].extend(cavity.cells),
            None => homeless.push(cavity),
        }
    }
    outward.iter_mut().zip(cavities).for_each(|(body, cavities)| body.cells.extend(cavities));
    outward.extend(homeless);
    outward
}

fn is_within(surface: &Surface, body: &FoundBody, p: Vec3) -> bool {
    alone(surface, &body.cells).to_trimesh().project_local_point(to_parry(p), false).is_inside
}

/// The triangles `cells` of `surface` by themselves.
fn alone(surface: &Surface, cells: &[u32]) -> Surface {
    let mut triangles: Vec<[u32; 3]> = cells.iter().map(|t| surface.triangles[*t as usize]).collect();
    let mut named: Vec<u32> = triangles.as_flattened().to_vec();
    named.sort_unstable();
    named.dedup();
    let number = |v: u32| named.binary_search(&v).unwrap_or_default() as u32;
    triangles.iter_mut().for_each(|t| *t = t.map(number));
    Surface { vertices: named.iter().map(|v| surface.vertices[*v as usize]).collect(), triangles }
}

/// The cells `kept`, ascending, of `solid`.
fn of_cells(solid: Solid, kept: &[u32]) -> Solid {
    match solid {
        Solid::Surface(surface) => Solid::Surface(alone(&surface, kept)),
        Solid::Volume(LabelledMesh { mesh, mut labels, mut directions }) => {
            let mut elements: Vec<[u32; 4]> = kept.iter().map(|e| mesh.elements[*e as usize]).collect();
            let nodes = keep_referenced(&mesh.nodes, &mut elements);
            if !labels.of.is_empty() {
                labels.of = kept.iter().map(|e| labels.of[*e as usize]).collect();
            }
            if !directions.is_empty() {
                directions = kept.iter().map(|e| directions[*e as usize]).collect();
            }
            Solid::Volume(LabelledMesh { mesh: TetMesh { nodes, elements }, labels, directions })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::sphere_surface;
    use palpate_core::geometry::primitives::box_mesh;

    /// A ball of `radius` [m] around `centre`.
    fn ball(radius: Real, centre: Vec3, inward: bool) -> Surface {
        let mut ball = sphere_surface(radius, 0.4 * radius);
        ball.vertices.iter_mut().for_each(|v| *v += centre);
        if inward {
            ball.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        ball
    }

    fn together(parts: &[Surface]) -> Solid {
        let mut all = Surface::default();
        for part in parts {
            let first = all.vertices.len() as u32;
            all.vertices.extend(&part.vertices);
            all.triangles.extend(part.triangles.iter().map(|t| t.map(|v| v + first)));
        }
        Solid::Surface(all)
    }

    #[test]
    fn specks_far_below_an_element_are_dropped_and_counted_and_a_second_body_is_refused_with_the_sizes() {
        let organ = ball(0.05, Vec3::zeros(), false);
        let specks = [Vec3::new(0.06, 0.0, 0.0), Vec3::new(0.0, -0.07, 0.01), Vec3::new(0.01, 0.0, 0.0)]
            .map(|at| ball(1e-4, at, false));
        let all = together(&[&[organ.clone()][..], &specks].concat());
        let (one, said) = one_body(all.clone(), 0.005, false).unwrap();
        assert_eq!(one, Solid::Surface(organ.clone()));
        assert!(said.unwrap().starts_with("3 specks dropped, the largest 0.3"));
        // Finer elements would show them.
        let e = one_body(all, 2e-4, false).unwrap_err().to_string();
        assert!(
            e.contains("4 bodies") && e.contains("170.807 mm") && e.contains("0.3") && e.contains("--largest"),
            "{e}"
        );

        let two = together(&[ball(0.02, Vec3::x() * 0.2, false), organ.clone(), specks[0].clone()]);
        let e = one_body(two.clone(), 0.005, false).unwrap_err();
        assert!(matches!(e, ShapeFault::SeveralBodies { count: 2, within: false, .. }), "{e}");
        let (one, said) = one_body(two, 0.005, true).unwrap();
        assert_eq!(one, Solid::Surface(organ.clone()));
        assert!(said.unwrap().contains("1 specks dropped, the largest 0.3"));
        let island = together(&[organ, ball(0.02, Vec3::zeros(), false)]);
        assert!(one_body(island, 0.005, false).unwrap_err().to_string().contains("within the first"));
    }

    #[test]
    fn cavities_are_part_of_their_body_however_many_and_go_with_it() {
        let organ = ball(0.05, Vec3::zeros(), false);
        let place =
            |i: u32| Vec3::new(f64::from(i % 9) - 4.0, f64::from(i / 9 % 9) - 4.0, f64::from(i / 81) - 0.5) * 5e-3;
        let cavities: Vec<Surface> = (0..100).map(|i| ball(1e-3, place(i), true)).collect();
        let hollow = together(&[vec![organ], cavities].concat());
        assert_eq!(one_body(hollow.clone(), 0.005, false).unwrap(), (hollow, None));
        // An island in a cavity, with a cavity of its own.
        let (shell, cave) = (ball(0.05, Vec3::zeros(), false), ball(0.04, Vec3::zeros(), true));
        let island = [ball(0.02, Vec3::zeros(), false), ball(0.01, Vec3::zeros(), true)];
        let nested = together(&[&[shell.clone(), cave.clone()][..], &island].concat());
        assert!(one_body(nested.clone(), 0.005, false).is_err());
        assert_eq!(one_body(nested, 0.005, true).unwrap().0, together(&[shell, cave]));
    }

    #[test]
    fn small_pieces_of_a_mesh_go_with_their_labels() {
        let mut mesh = box_mesh(Vec3::repeat(0.1), [2; 3]);
        let (count, all) = (mesh.nodes.len() as u32, mesh.elements.len());
        let speck = box_mesh(Vec3::repeat(1e-3), [1; 3]);
        mesh.nodes.extend(speck.nodes.iter().map(|p| p + Vec3::repeat(0.2)));
        mesh.elements.splice(0..0, speck.elements.iter().map(|e| e.map(|n| n + count)));
        let of: Vec<i64> = (0..mesh.elements.len()).map(|e| i64::from(e >= speck.elements.len())).collect();
        let directions = of.iter().map(|label| if *label == 1 { Vec3::x() } else { Vec3::y() }).collect();
        let labels = crate::geometry::Labels { name: "a".into(), of };
        let (one, said) = one_body(Solid::Volume(LabelledMesh { mesh, labels, directions }), 0.05, false).unwrap();
        let Solid::Volume(one) = one else { panic!() };
        assert_eq!((one.mesh, one.labels.of), (box_mesh(Vec3::repeat(0.1), [2; 3]), vec![1; all]));
        assert_eq!(one.directions, vec![Vec3::x(); all]);
        assert!(said.unwrap().starts_with("1 specks dropped"));
    }
}
