//! What is between two organs that meet, or two places of one.

use garde::Validate;
use palpate_core::contact::meeting::Between;
use palpate_core::ids::OrganId;
use palpate_core::math::Real;
use serde::{Deserialize, Serialize};

/// `[[contact]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct ContactKeys {
    /// Names of two organs, or twice that of one which folds onto itself; that of `[body]` is the name of the scene.
    pub between: [String; 2],
    /// Coulomb's coefficient of friction between them.
    #[garde(range(min = 0.0, max = 2.0))]
    pub friction: Real,
}

fn organ_named(names: &[&str], name: &str) -> Option<OrganId> {
    names.iter().position(|own| *own == name).map(OrganId::at)
}

/// Friction between organs of these `names`: none where the `contacts` give none, as between wet ones.
pub(super) fn friction(contacts: &[ContactKeys], names: &[&str]) -> Between {
    let mut between = Between::default();
    for contact in contacts {
        if let [Some(a), Some(b)] = contact.between.each_ref().map(|name| organ_named(names, name)) {
            between.set(a, b, contact.friction);
        }
    }
    between
}

/// Adds what is wrong with the `contacts` of organs of these `names`.
pub(super) fn faults(contacts: &[ContactKeys], names: &[&str], out: &mut Vec<(String, String)>) {
    for (i, contact) in contacts.iter().enumerate() {
        let organs = contact.between.each_ref().map(|name| organ_named(names, name));
        let is_same = |other: &ContactKeys| {
            let [a, b] = &other.between;
            contact.between == [a.clone(), b.clone()] || contact.between == [b.clone(), a.clone()]
        };
        let fault = match organs {
            [Some(_), Some(_)] if contacts[..i].iter().any(is_same) => "these two stand further up".into(),
            [Some(_), Some(_)] => continue,
            [first, _] => {
                let unknown = &contact.between[usize::from(first.is_some())];
                format!("no organ is called {unknown:?}: there is {}", names.join(", "))
            }
        };
        out.push((format!("contact[{i}].between"), fault));
    }
}
