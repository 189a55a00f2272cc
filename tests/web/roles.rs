//! A gateway at a server that asks for certificates: its pages may do what its own role may.

use crate::Web;
use crate::browser::{Heard, Page};
use crate::secured::Secured;
use palpate_web::Rights;

/// A page of an operator's address, at a gateway with the certificate of `name`, to which the surface has come.
fn page_of(secured: &Secured, name: &str) -> (Web, Page) {
    let web = Web::start(&secured.endpoints(Some(&format!("certificates/clients/{name}"))));
    let mut page = web.page(Rights::Operator);
    page.wait("a frame", |heard| matches!(heard, Heard::Frame(_)).then_some(()));
    (web, page)
}

#[test]
fn a_page_sees_and_touches_with_the_certificate_of_its_gateway() {
    let secured = Secured::start();
    let (_web, mut page) = page_of(&secured, "anna");
    let hand = page.attach("left").unwrap();
    // Where poses came so late that the tool was let go, it has to be outside before it is felt again.
    let pressed = (0..10).any(|_| {
        page.press(hand, 0.02, 0.02, 10);
        page.press(hand, 0.02, -0.008, 40).is_some_and(|wrench| wrench.force[2] > 0.1)
    });
    assert!(pressed, "pressed ten times, and never felt");
    let refused = page.attach("right").unwrap_err();
    assert!(refused.contains("no tool \"right\": there is left for you"), "{refused}");
}

#[test]
fn a_page_of_a_viewer_s_gateway_sees_and_is_told_that_it_may_not_touch() {
    let secured = Secured::start();
    let (_web, mut page) = page_of(&secured, "wall");
    let refused = page.attach("left").unwrap_err();
    assert!(refused.contains("wall is viewer on this server, and may not attach"), "{refused}");
    page.wait("another frame", |heard| matches!(heard, Heard::Frame(_)).then_some(()));
}
