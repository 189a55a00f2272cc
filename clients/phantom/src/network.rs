//! Arguments of a bad network, and of how the force is rendered over it: for `palpate-phantom` and `palpate demo` alike.

use anyhow::{Result, ensure};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use palpate_sdk::{LinkConditions, RenderMode};

/// How the force is rendered, and what delays, jitters and loses poses and wrenches on purpose.
#[derive(Args, Clone, Debug)]
pub struct Network {
    /// How the force is made from the wrenches.
    #[arg(long, value_parser = render_mode(), ignore_case = true, default_value = "local-passive")]
    pub render: RenderMode,
    /// Delay added each way [ms].
    #[arg(long, default_value_t = 0.0)]
    pub delay_ms: f64,
    /// Up to this much more each way, uniformly distributed [ms].
    #[arg(long, default_value_t = 0.0)]
    pub jitter_ms: f64,
    /// Share of poses and of wrenches that is lost, 0 to 1.
    #[arg(long, default_value_t = 0.0)]
    pub loss: f64,
    /// Seed of jitter and loss.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

/// A mode by its name: the library that has the modes does without clap.
fn render_mode() -> impl TypedValueParser<Value = RenderMode> {
    PossibleValuesParser::new(RenderMode::names()).try_map(|name| name.parse::<RenderMode>())
}

impl Network {
    /// Errors: a time that is negative or over 10 s, a loss that is no share.
    pub fn conditions(&self) -> Result<LinkConditions> {
        for (name, ms) in [("delay-ms", self.delay_ms), ("jitter-ms", self.jitter_ms)] {
            ensure!((0.0..=10_000.0).contains(&ms), "{name} is {ms}: it must be 0 to 10000");
        }
        let [delay_ns, jitter_ns] = [self.delay_ms, self.jitter_ms].map(|ms| (ms * 1e6) as u64);
        let conditions = LinkConditions { delay_ns, jitter_ns, loss: self.loss };
        conditions.check()?;
        Ok(conditions)
    }
}
