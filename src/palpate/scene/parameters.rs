//! What may change while a scene runs, by the names that people and clients give it.

use super::Scene;
use super::body_keys::RegionKeys;
use palpate_core::adaptation::Adaptivity;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Body;
use palpate_core::simulation::{Parameter, ParameterRanges, Threshold};

impl Scene {
    /// Names of the tissues of its body, in the order of their numbers: of each organ its own name, and after it those of its
    /// regions, with the name of a further organ before them.
    pub fn tissues(&self) -> Vec<String> {
        let names = |organ: &str, before: &str, regions: &[RegionKeys]| -> Vec<String> {
            let region = |(i, keys): (usize, &RegionKeys)| match &keys.name {
                Some(name) => format!("{before}{name}"),
                None => format!("{before}region{}", i + 1),
            };
            std::iter::once(organ.to_owned()).chain(regions.iter().enumerate().map(region)).collect()
        };
        let further = |organ: &super::organ_keys::OrganKeys| {
            names(&organ.name, &format!("{}.", organ.name), &organ.material.region)
        };
        let first = names(&self.name, "", &self.material.region);
        first.into_iter().chain(self.organ.iter().flat_map(further)).collect()
    }

    /// The name of a parameter's quantity.
    pub fn parameter_name(&self, parameter: &Parameter) -> String {
        match parameter {
            Parameter::Gravity(_) => "gravity".into(),
            Parameter::Damping(_) => "damping".into(),
            Parameter::Supports(_) => "supports".into(),
            Parameter::Resolution { threshold, .. } => format!("resolution.{}", threshold.name()),
            Parameter::Stiffness { tissue, .. } => {
                let names = self.tissues();
                format!("stiffness.{}", names.get(usize::from(*tissue)).cloned().unwrap_or_else(|| tissue.to_string()))
            }
            Parameter::Friction { tool, .. } => format!("friction.{}", self.tool_name(*tool)),
            Parameter::Shape { tool, .. } => format!("shape.{}", self.tool_name(*tool)),
        }
    }

    fn tool_name(&self, tool: u16) -> String {
        self.tool.get(usize::from(tool)).map_or_else(|| tool.to_string(), |tool| tool.name.clone())
    }

    /// Every quantity that may change, as the scene has it.
    pub fn parameters(&self) -> Vec<Parameter> {
        let stiffness = (0..self.tissues().len() as u16).map(|tissue| Parameter::Stiffness { tissue, factor: 1.0 });
        let friction =
            (0..).zip(&self.tool).map(|(tool, keys)| Parameter::Friction { tool, coefficient: keys.friction });
        let shapes = (0..self.tool.len() as u16).map(|tool| Parameter::Shape { tool, of: tool });
        let others =
            [Parameter::Gravity(Vec3::from(self.world.gravity)), Parameter::Damping(1.0), Parameter::Supports(1.0)];
        let adaptivity = self.settings().adaptivity;
        let resolution = adaptivity.iter().flat_map(|Adaptivity { split, merge, reach, .. }| {
            let values = [*split, *merge, *reach];
            Threshold::ALL.into_iter().zip(values).map(|(threshold, value)| Parameter::Resolution { threshold, value })
        });
        others.into_iter().chain(stiffness).chain(friction).chain(shapes).chain(resolution).collect()
    }

    /// The quantities called `name`, given `values`: "stiffness", "friction" and "shape" alone mean those of every
    /// tissue, or tool, and a number stands for a name. Their ranges are not looked at.
    ///
    /// # Errors
    /// In words: no such name, another number of values, or a shape that is none of a tool.
    pub fn parameters_named(&self, name: &str, values: &[Real]) -> Result<Vec<Parameter>, String> {
        let all = self.parameters();
        let is_meant = |parameter: &&Parameter| {
            let own = self.parameter_name(parameter);
            let number = match parameter {
                Parameter::Stiffness { tissue: number, .. }
                | Parameter::Friction { tool: number, .. }
                | Parameter::Shape { tool: number, .. } => Some(*number),
                _ => None,
            };
            let kind = own.split_once('.').map_or(own.as_str(), |(kind, _)| kind);
            let numbered = name.strip_prefix(kind).and_then(|rest| rest.strip_prefix('.')?.parse().ok());
            own == name || number.is_some() && (name == kind || numbered == number)
        };
        let meant: Vec<_> = all.iter().filter(is_meant).collect();
        if meant.is_empty() {
            let names: Vec<_> = all.iter().map(|parameter| self.parameter_name(parameter)).collect();
            return Err(format!("no parameter of that name: there is {}", names.join(", ")));
        }
        let wanted = |parameter: &Parameter| {
            let needed = parameter.values().len();
            let few =
                || format!("{name} has {needed} value{}, not {}", if needed == 1 { "" } else { "s" }, values.len());
            let value = || <[Real; 1]>::try_from(values).map(|[value]| value).map_err(|_| few());
            Ok(match *parameter {
                Parameter::Gravity(_) => {
                    Parameter::Gravity(Vec3::from(<[Real; 3]>::try_from(values).map_err(|_| few())?))
                }
                Parameter::Damping(_) => Parameter::Damping(value()?),
                Parameter::Supports(_) => Parameter::Supports(value()?),
                Parameter::Resolution { threshold, .. } => Parameter::Resolution { threshold, value: value()? },
                Parameter::Stiffness { tissue, .. } => Parameter::Stiffness { tissue, factor: value()? },
                Parameter::Friction { tool, .. } => Parameter::Friction { tool, coefficient: value()? },
                Parameter::Shape { tool, .. } => {
                    let of = value()?;
                    Parameter::shape(tool, of).ok_or_else(|| format!("{name} is {of}: give the number of a tool"))?
                }
            })
        };
        meant.into_iter().map(wanted).collect()
    }

    /// Adds `parameters` to those that have been `set`, where each is within its range.
    ///
    /// # Errors
    /// Of the first that is not, in words with its name and its range.
    pub fn check_parameters(
        &self,
        body: &Body,
        ranges: &ParameterRanges,
        parameters: &[Parameter],
        set: &mut Vec<Parameter>,
    ) -> Result<(), String> {
        for parameter in parameters {
            let name = || self.parameter_name(parameter);
            let range = ranges.of(body, parameter, set).ok_or_else(|| format!("there is no {}", name()))?;
            if let Some(value) = parameter.values().into_iter().find(|value| !range.contains(value)) {
                return Err(format!("{} is {value}: {} to {} is allowed", name(), range.start(), range.end()));
            }
            match set.iter_mut().find(|set| set.is_same_quantity(parameter)) {
                Some(set) => *set = *parameter,
                None => set.push(*parameter),
            }
        }
        Ok(())
    }
}
