//! The guide: a page per topic.
//!
//! | page | for |
//! |---|---|
//! | [`scenes`] | describing a body, its supports and tools |
//! | [`bodies`] | mesh files, and `palpate prepare` |
//! | [`commands`] | the command line |
//! | [`clients`] | devices, headsets, C, other languages |
//! | [`surface`] | viewers of your own, and the viewer |
//! | [`web`] | the page for browsers, phones and headsets |
//! | [`recordings`] | recordings, replay, trajectories |
//! | [`trust`] | other machines: certificates, roles |
//! | [`faults`] | what happens when something goes wrong; limits |
//! | [`method`] | levels, material, time stepping |
//! | [`contact`] | tools, contact points, friction |
//! | [`resolution`] | refinement, governor, budget |
//! | [`remote`] | hands far away |
//! | [`figures`] | what a live run gives; the rest is in the report of the studies |
//!
//! Terms and symbols: the [glossary](palpate_core::glossary).

#![warn(rustdoc::broken_intra_doc_links)]

/// A page from its file. Of several definitions of a link Markdown takes the first: these lead to the documentation, and those
/// at the end of each file, which count where the file is read by itself, to files of the repository.
macro_rules! page {
    ($name:ident) => {
        /// [`bodies`]: bodies
        /// [`clients`]: clients
        /// [`commands`]: commands
        /// [`contact`]: contact
        /// [`faults`]: faults
        /// [`figures`]: figures
        /// [`method`]: method
        /// [`recordings`]: recordings
        /// [`remote`]: remote
        /// [`resolution`]: resolution
        /// [`scenes`]: scenes
        /// [`surface`]: surface
        /// [`trust`]: trust
        /// [`web`]: web
        /// [glossary]: palpate_core::glossary
        /// [report]: commands
        /// [`palpate_body`]: palpate_body
        /// [`palpate_body::geometry::mesh_io`]: palpate_body::geometry::mesh_io
        /// [`palpate_body::prepare::body_file`]: palpate_body::prepare::body_file
        /// [`palpate_body::prepare::calibration`]: palpate_body::prepare::calibration
        /// [`palpate_core::contact`]: palpate_core::contact
        /// [`palpate_core::contact::ground`]: palpate_core::contact::ground
        /// [`palpate_core::contact::meeting`]: palpate_core::contact::meeting
        /// [`palpate_core::contact::jaws`]: palpate_core::contact::jaws
        /// [`palpate_core::contact::obstacle`]: palpate_core::contact::obstacle
        /// [`palpate_core::feedback::relaxed`]: palpate_core::feedback::relaxed
        /// [`palpate_core::hierarchy`]: palpate_core::hierarchy
        /// [`palpate_core::model::active_set`]: palpate_core::model::active_set
        /// [`palpate_core::model::element_kernel`]: palpate_core::model::element_kernel
        /// [`palpate_core::model::body::stars`]: palpate_core::model::body::stars
        /// [`palpate_core::model::active_mesh::contact_row`]: palpate_core::model::active_mesh::contact_row
        /// [`palpate_core::model::material`]: palpate_core::model::material
        /// [`palpate_core::model::fibres`]: palpate_core::model::fibres
        /// [`palpate_core::stepping`]: palpate_core::stepping
        /// [`palpate_core::stepping::constraint_solve`]: palpate_core::stepping::constraint_solve
        /// [`palpate_core::stepping::governor`]: palpate_core::stepping::governor
        /// [`palpate_core::stepping::work`]: palpate_core::stepping::work
        /// [`contract.md`]: palpate_proto
        /// [`palpate_proto::surface`]: palpate_proto::surface
        /// [`palpate_sdk::Clutch`]: palpate_sdk::Clutch
        /// [`palpate_sdk::Connection::surface_pictures`]: palpate_sdk::Connection::surface_pictures
        /// [`palpate_sdk::Frame`]: palpate_sdk::Frame
        /// [`palpate_sdk::Link`]: palpate_sdk::Link
        /// [`palpate_sdk::Registration`]: palpate_sdk::Registration
        /// [`palpate_sdk::Renderer`]: palpate_sdk::Renderer
        /// [`palpate_sdk::Surface::from_parts`]: palpate_sdk::Surface::from_parts
        /// [`palpate_sdk::SurfaceDecoder`]: palpate_sdk::SurfaceDecoder
        /// [`palpate_web::message`]: palpate_web::message
        /// [`palpate::offline`]: crate::offline
        /// [`palpate::realtime`]: crate::realtime
        /// [`palpate::recording`]: crate::recording
        /// [`palpate::scene`]: crate::scene
        ///
        #[doc = include_str!(concat!("guide/", stringify!($name), ".md"))]
        pub mod $name {}
    };
}

page!(bodies);
page!(clients);
page!(commands);
page!(contact);
page!(faults);
page!(figures);
page!(method);
page!(recordings);
page!(remote);
page!(resolution);
page!(scenes);
page!(surface);
page!(trust);
page!(web);

#[cfg(test)]
mod tests {
    use crate::scene;
    use crate::server::Roles;
    use std::path::{Path, PathBuf};

    const README: &str = include_str!("../../README.md");

    /// Definitions of links, `[label]: target`, in lines of `text` that start with `before`.
    fn definitions<'a>(text: &'a str, before: &str) -> Vec<(&'a str, &'a str)> {
        let definition = |line: &'a str| line.trim_start().strip_prefix(before)?.strip_prefix('[')?.split_once("]: ");
        text.lines().filter_map(definition).collect()
    }

    /// Files of Markdown in `folder` and below, but for what is built or hidden.
    fn markdown(folder: &Path, out: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if path.is_dir() && name != "target" && !name.starts_with('.') {
                markdown(&path, out);
            } else if path.extension().is_some_and(|e| e == "md") {
                out.push(path);
            }
        }
    }

    /// Content of the fenced blocks of `language` in `text`.
    fn blocks<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
        let fence = format!("```{language}\n");
        text.split(&fence).skip(1).filter_map(|rest| rest.split("```").next()).collect()
    }

    #[test]
    fn every_scene_in_readme_and_guide_is_valid() {
        let pages = [README, include_str!("guide/scenes.md"), include_str!("guide/resolution.md")];
        for (i, page) in pages.into_iter().enumerate() {
            let scenes = blocks(page, "toml");
            assert!(!scenes.is_empty(), "page {i}");
            scenes.iter().for_each(|text| drop(scene::parse(text, "a page").unwrap()));
        }
    }

    #[test]
    fn roles_in_the_guide_and_of_the_example_are_valid_for_the_liver() {
        let liver = scene::LoadedScene::load(Path::new("liver"), &[]).unwrap().scene;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("roles.toml");
        let example = include_str!("../../config/roles.toml");
        for text in blocks(include_str!("guide/trust.md"), "toml").into_iter().chain([example]) {
            std::fs::write(&file, text).unwrap();
            Roles::read(&file).unwrap().clients(&liver).unwrap();
        }
    }

    #[test]
    fn the_device_in_the_guide_is_valid() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("device.toml");
        std::fs::write(&file, blocks(include_str!("guide/clients.md"), "toml")[0]).unwrap();
        assert_eq!(palpate_sdk::Device::from_file(&file).unwrap().max_torque, 0.188);
    }

    #[test]
    fn the_library_example_of_readme_is_that_of_the_core() {
        let core = include_str!("../core/examples/press_a_cube.rs");
        let [example] = blocks(README, "rust")[..] else { panic!("one example") };
        for line in example.lines() {
            assert!(core.contains(line), "{line}");
        }
    }

    #[test]
    fn readme_is_short() {
        assert!(README.lines().count() <= 150);
    }

    #[test]
    fn links_of_every_page_lead_to_files() {
        let mut pages = vec![];
        markdown(Path::new(env!("CARGO_MANIFEST_DIR")), &mut pages);
        let mut found = 0;
        for page in pages {
            let text = std::fs::read_to_string(&page).unwrap();
            let inline = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
            let targets = inline.chain(definitions(&text, "").into_iter().map(|(_, target)| target));
            for target in targets.filter(|target| !target.starts_with("http")) {
                let file = target.split('#').next().unwrap_or_default();
                assert!(page.with_file_name(file).exists(), "{}: {target}", page.display());
                found += 1;
            }
        }
        assert!(found > 60, "{found} links");
    }

    #[test]
    fn links_of_the_guide_lead_to_the_documentation_here_and_to_files_elsewhere() {
        let here = definitions(include_str!("guide.rs"), "/// ");
        let mut pages = vec![];
        markdown(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src/palpate/guide"), &mut pages);
        for page in pages {
            let text = std::fs::read_to_string(&page).unwrap();
            let elsewhere = definitions(&text, "");
            for (label, _) in &elsewhere {
                assert!(here.iter().any(|(known, _)| known == label), "{}: no item for {label}", page.display());
            }
            // Outside of code every link to an item has a file.
            let prose: String = text.split("```").step_by(2).collect();
            for label in prose.split("[`").skip(1).filter_map(|rest| rest.split("`]").next()) {
                let label = format!("`{label}`");
                assert!(elsewhere.iter().any(|(known, _)| *known == label), "{}: no file for {label}", page.display());
            }
        }
    }
}
