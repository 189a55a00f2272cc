//! An organ with pictures on it.

use crate::browser::{Heard, get};
use crate::textured_cube::textured_cube;
use crate::{Server, Web, free_endpoints};
use palpate_web::Rights;

#[test]
fn pictures_on_the_organ_go_to_who_may_watch_as_their_files_have_them() {
    let folder = tempfile::tempdir().unwrap();
    let scene = textured_cube(folder.path(), 8);
    let endpoints = free_endpoints();
    let _server = Server::of(scene.to_str().unwrap(), &[], &endpoints);
    let web = Web::start(&endpoints);
    let visitor = web.visitor(Rights::Viewer);
    let mut page = visitor.page();
    let surface = page.wait("the first part of a surface", |heard| match heard {
        Heard::Topology(part) if part.part == 0 => Some(part),
        _ => None,
    });
    let looks: Vec<_> = surface.materials.iter().map(|m| (&m.name[..], m.picture)).collect();
    assert_eq!(looks, [("top", 1), ("sides", 0)]);
    assert!(!surface.uvs.is_empty());
    let path = |surface, number| format!("/picture/{surface}/{number}");
    let picture = visitor.get(&path(surface.topology, 1));
    assert_eq!((picture.status, picture.header("content-type")), (200, Some("image/png")));
    assert_eq!(picture.body, std::fs::read(folder.path().join("top.png")).unwrap());
    assert_eq!(visitor.get(&path(surface.topology, 2)).status, 404);
    assert_eq!(visitor.get(&path(surface.topology.wrapping_add(1), 1)).status, 404);
    assert_eq!(get(&visitor.host, &path(surface.topology, 1), &[]).status, 403, "without a cookie");
}
