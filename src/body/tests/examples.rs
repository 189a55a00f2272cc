//! The example does what it says.

#[path = "../examples/make_a_body.rs"]
#[allow(dead_code, reason = "its main function writes where the user is")]
mod make_a_body;

use palpate_body::prepare::body_file::BodyFile;

#[test]
fn a_saved_body_is_read_back_as_it_was_made() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ball.palpate");
    make_a_body::make_a_body(&file).unwrap();
    let read = BodyFile::read(&file).unwrap();
    assert!((read.body.mass() - 0.52).abs() < 0.02 && read.body.levels().len() == 2);
    assert_eq!(read.bytes(), std::fs::read(&file).unwrap());
}
