//! Elastic constants of a scene: Young's modulus and Poisson's ratio, or Lamé's parameters λ and μ.
//!
//! The three tables that give them list the four keys themselves: serde does not refuse unknown keys in a table that has
//! another one's keys flattened into it.

use palpate_body::prepare::Elements;
use palpate_core::math::Real;
use palpate_core::model::Material;
use serde::Deserialize;

/// Young's modulus where a scene gives no elastic constants [Pa]: that of soft liver.
const YOUNGS_MODULUS: Real = 5e3;
/// Poisson's ratio where a scene gives none: nearly incompressible.
const POISSON_RATIO: Real = 0.45;
/// Range of Young's modulus [Pa].
pub(super) const STIFFNESS: (Real, Real) = (10.0, 1e9);
/// Largest Poisson's ratio, of smoothed elements: as far as levels were shown to agree (test `levels`). At 0.5, λ is infinite; the closer to
/// it, the smaller the steps.
pub(super) const LARGEST_POISSON_RATIO: Real = 0.499;
/// And of linear tetrahedra, which lock: at this the finest level of a bar bends a fifth too little, and closer to 0.5 ever less.
const LARGEST_OF_TETRAHEDRA: Real = 0.49;
/// Part by which constants computed from λ and μ may miss the ranges: more than their rounding.
const ROUNDING: Real = 1e-12;

/// Elastic constants as a table of a scene gives them: of one of two pairs.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(super) struct ElasticKeys {
    /// Young's modulus [Pa].
    pub(super) youngs_modulus: Option<Real>,
    /// Poisson's ratio.
    pub(super) poisson_ratio: Option<Real>,
    /// Lamé's first parameter λ [Pa].
    pub(super) lambda: Option<Real>,
    /// Shear modulus μ [Pa].
    pub(super) mu: Option<Real>,
}

impl ElasticKeys {
    /// `λ` and `μ` [Pa], where both are given.
    fn lame(&self) -> Option<(Real, Real)> {
        self.lambda.zip(self.mu)
    }

    /// The material of this density and no viscosity; Young's modulus and Poisson's ratio left out are the defaults.
    pub(super) fn material(&self, density: Real) -> Material {
        match self.lame() {
            Some((lambda, mu)) => Material { lambda, mu, ..Material::from_young(1.0, 0.0, density) },
            None => {
                let youngs_modulus = self.youngs_modulus.unwrap_or(YOUNGS_MODULUS);
                Material::from_young(youngs_modulus, self.poisson_ratio.unwrap_or(POISSON_RATIO), density)
            }
        }
    }

    /// Young's modulus [Pa] and Poisson's ratio: as given, or those of λ and μ. Defaults stand for what is left out.
    pub(super) fn young(&self) -> (Real, Real) {
        match self.lame() {
            Some(_) => {
                let material = self.material(1.0);
                (material.youngs_modulus(), material.poisson_ratio())
            }
            None => (self.youngs_modulus.unwrap_or(YOUNGS_MODULUS), self.poisson_ratio.unwrap_or(POISSON_RATIO)),
        }
    }

    /// The key that is wrong, and why: both pairs, half a pair, or what is no elastic material that can be simulated by these `elements`.
    fn fault(&self, elements: Elements) -> Option<(&'static str, String)> {
        let (largest, remedy) = match elements {
            Elements::Tetrahedra => {
                (LARGEST_OF_TETRAHEDRA, format!("; up to {LARGEST_POISSON_RATIO} with elements = \"smoothed\""))
            }
            Elements::Smoothed => (LARGEST_POISSON_RATIO, String::new()),
        };
        let (lambda, mu) = match (self.lambda, self.mu) {
            (None, None) => {
                let found = self.poisson_ratio.filter(|nu| *nu > largest)?;
                return Some(("poisson_ratio", format!("give 0 to {largest}, not {found}{remedy}")));
            }
            (lambda, _) if self.youngs_modulus.is_some() || self.poisson_ratio.is_some() => {
                let key = if lambda.is_some() { "lambda" } else { "mu" };
                let fault = "give lambda and mu, or youngs_modulus and poisson_ratio, not keys of both pairs";
                return Some((key, fault.into()));
            }
            (Some(_), None) => return Some(("lambda", "needs mu [Pa] beside it".into())),
            (None, Some(_)) => return Some(("mu", "needs lambda [Pa] beside it".into())),
            (Some(lambda), Some(mu)) => (lambda, mu),
        };
        if !(mu.is_finite() && mu > 0.0) {
            return Some(("mu", format!("give a shear modulus above 0 Pa; it is {mu}")));
        }
        let bulk = 3.0 * lambda + 2.0 * mu;
        if !(bulk.is_finite() && bulk > 0.0) {
            let fault =
                format!("give one with 3 lambda + 2 mu above 0 Pa, or the body expands under pressure; it is {bulk}");
            return Some(("lambda", fault));
        }
        let (youngs_modulus, poisson_ratio) = self.young();
        if !(0.0..=largest * (1.0 + ROUNDING)).contains(&poisson_ratio) {
            let most = 2.0 * mu * largest / (1.0 - 2.0 * largest);
            let fault = format!(
                "give 0 to {most:.6} Pa with this mu, for a Poisson's ratio of 0 to {largest}; that of {lambda} is {poisson_ratio:.6}{remedy}"
            );
            return Some(("lambda", fault));
        }
        let (least, most) = STIFFNESS;
        (!(least * (1.0 - ROUNDING)..=most * (1.0 + ROUNDING)).contains(&youngs_modulus)).then(|| {
            let fault =
                format!("Young's modulus of lambda and mu is {youngs_modulus:.6} Pa, and must be {least} to {most}");
            ("mu", fault)
        })
    }

    /// Adds what is wrong with the keys together, in the table `path`.
    pub(super) fn faults(&self, path: &str, elements: Elements, out: &mut Vec<(String, String)>) {
        out.extend(self.fault(elements).map(|(key, fault)| (format!("{path}.{key}"), fault)));
    }

    /// Adds what is wrong with the keys of a region in the table `path`, which has no defaults.
    pub(super) fn region_faults(&self, path: &str, elements: Elements, out: &mut Vec<(String, String)>) {
        match (self.youngs_modulus, self.lambda, self.mu) {
            (None, None, None) => out.push((path.to_owned(), "give youngs_modulus, or lambda and mu".into())),
            _ => self.faults(path, elements, out),
        }
    }
}

/// Rewrites the elastic constants of a prepared body's `material` as the pair of which `given` has a key: what a scene gives
/// then replaces one key of a pair and never mixes two.
pub(super) fn as_given(material: &mut toml::Table, given: &toml::Table) {
    const YOUNG: [&str; 2] = ["youngs_modulus", "poisson_ratio"];
    const LAME: [&str; 2] = ["lambda", "mu"];
    let has = |table: &toml::Table, pair: [&str; 2]| pair.iter().any(|key| table.contains_key(*key));
    if has(given, LAME) {
        material.retain(|key, _| YOUNG.iter().all(|of| *of != key));
    } else if has(given, YOUNG)
        && has(material, LAME)
        && let Ok(prepared) = material.clone().try_into::<ElasticKeys>()
    {
        material.retain(|key, _| LAME.iter().all(|of| *of != key));
        let (youngs_modulus, poisson_ratio) = prepared.young();
        material.extend([(YOUNG[0].into(), youngs_modulus.into()), (YOUNG[1].into(), poisson_ratio.into())]);
    }
}

/// Writes the defaults of Young's modulus and Poisson's ratio into keys of which neither pair is given whole.
pub(super) fn fill(keys: ElasticKeys, youngs_modulus: &mut Option<Real>, poisson_ratio: &mut Option<Real>) {
    if keys.lame().is_none() {
        let (e, nu) = keys.young();
        (*youngs_modulus, *poisson_ratio) = (Some(e), Some(nu));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prepared_body_takes_what_a_scene_gives_as_one_pair() {
        let (young, lame) = ("youngs_modulus = 5e3\npoisson_ratio = 0.4\n", "lambda = 6000.0\nmu = 4000.0\n");
        for (prepared, given, expected) in [
            (young, "", young),
            (lame, "", lame),
            (young, "poisson_ratio = 0.3", "youngs_modulus = 5e3\npoisson_ratio = 0.3"),
            (young, lame, lame),
            // λ = 6000 and μ = 4000 are E = 10,400 and ν = 0.3.
            (lame, "youngs_modulus = 8e3", "youngs_modulus = 8e3\npoisson_ratio = 0.3"),
            (lame, "poisson_ratio = 0.4", "youngs_modulus = 10400.0\npoisson_ratio = 0.4"),
        ] {
            let table = |text: &str| toml::from_str::<toml::Table>(text).unwrap();
            let (mut material, given) = (table(prepared), table(given));
            as_given(&mut material, &given);
            material.extend(given);
            assert_eq!(material, table(expected));
        }
    }
}
