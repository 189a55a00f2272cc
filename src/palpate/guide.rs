//! The guide: a page per topic.
//!
//! | page | for |
//! |---|---|
//! | [`scenes`] | describing a body, its supports and tools |
//! | [`bodies`] | mesh files, and `palpate prepare` |
//! | [`commands`] | the command line |
//! | [`clients`] | devices, headsets, C, other languages |
//! | [`surface`] | viewers of your own, and the viewer |
//! | [`recordings`] | recordings, replay, trajectories |
//! | [`faults`] | what happens when something goes wrong; limits |
//! | [`method`] | levels, material, time stepping |
//! | [`contact`] | tools, contact points, friction |
//! | [`resolution`] | refinement, governor, budget |
//! | [`remote`] | hands far away |
//! | [`figures`] | what was measured, and how |
//!
//! Terms and symbols: the [glossary](palpate_core::glossary).

#![warn(rustdoc::broken_intra_doc_links)]

#[doc = include_str!("guide/bodies.md")]
pub mod bodies {}
#[doc = include_str!("guide/clients.md")]
pub mod clients {}
#[doc = include_str!("guide/commands.md")]
pub mod commands {}
#[doc = include_str!("guide/contact.md")]
pub mod contact {}
#[doc = include_str!("guide/faults.md")]
pub mod faults {}
#[doc = include_str!("guide/figures.md")]
pub mod figures {}
#[doc = include_str!("guide/method.md")]
pub mod method {}
#[doc = include_str!("guide/recordings.md")]
pub mod recordings {}
#[doc = include_str!("guide/remote.md")]
pub mod remote {}
#[doc = include_str!("guide/resolution.md")]
pub mod resolution {}
#[doc = include_str!("guide/scenes.md")]
pub mod scenes {}
#[doc = include_str!("guide/surface.md")]
pub mod surface {}

#[cfg(test)]
mod tests {
    use crate::scene;
    use std::path::Path;

    const README: &str = include_str!("../../README.md");

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
    fn readme_is_short_and_its_links_resolve() {
        assert!(README.lines().count() <= 150);
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let links: Vec<&str> = README.split("](").skip(1).filter_map(|rest| rest.split(')').next()).collect();
        assert!(links.len() > 15);
        for link in links {
            assert!(link.starts_with("http") || root.join(link).exists(), "{link}");
        }
    }
}
