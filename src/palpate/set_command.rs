//! `palpate set`: what a running server may change while it simulates.

use anyhow::{Context, bail};
use clap::Args;
use palpate::say;
use palpate_proto::keys;
use std::path::PathBuf;
use std::process::ExitCode;

/// `palpate set`.
#[derive(Args)]
pub struct SetArgs {
    /// What to set, as in stiffness.nodule=2, gravity=[0,0,-9.81] or shape.left=needle; nothing: list what there is
    #[arg(value_name = "NAME=VALUE")]
    parameters: Vec<String>,
    /// Session name
    #[arg(long, default_value = keys::DEFAULT_SESSION)]
    session: String,
    /// Endpoint of the server's control
    #[arg(long, default_value = keys::DEFAULT_SURFACE_ENDPOINT)]
    surface_endpoint: String,
    /// Folder of your certificate, where the server asks for one
    #[arg(long, value_name = "FOLDER")]
    identity: Option<PathBuf>,
}

/// Sets all of it or nothing; without anything to set, a line for each parameter.
pub fn run(args: &SetArgs) -> anyhow::Result<ExitCode> {
    let parameters = args.parameters.iter().map(|given| parse(given)).collect::<anyhow::Result<Vec<_>>>()?;
    let names_tools = parameters.iter().any(|(_, value)| matches!(value, Value::Tool(_)));
    let endpoints = palpate_sdk::Endpoints {
        surface: args.surface_endpoint.clone(),
        session: args.session.clone(),
        identity: args.identity.clone(),
        ..Default::default()
    };
    let connection = palpate_sdk::Connection::open_surface(&endpoints)?;
    if !parameters.is_empty() {
        let tools = if names_tools { connection.session()?.tools } else { vec![] };
        let numbers = |(name, value): (String, Value)| match value {
            Value::Numbers(values) => Ok((name, values)),
            Value::Tool(called) => {
                let tool = tools.iter().find(|tool| tool.name == called);
                let tool = tool.with_context(|| format!("{name}={called}: there is no tool of that name"))?;
                Ok((name, vec![f64::from(tool.tool)]))
            }
        };
        connection.set_parameters(parameters.into_iter().map(numbers).collect::<anyhow::Result<Vec<_>>>()?)?;
        return Ok(ExitCode::SUCCESS);
    }
    for known in connection.session()?.parameters {
        let value = match known.values.as_slice() {
            [value] => value.to_string(),
            values => format!("{values:?}"),
        };
        say!("{}={value} ({} to {})", known.name, known.least, known.most)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// What a parameter is to be.
enum Value {
    Numbers(Vec<f64>),
    /// The number of the tool of this name.
    Tool(String),
}

/// Name and value of `name=value`, `name=[value, …]` or `shape.tool=tool`.
fn parse(given: &str) -> anyhow::Result<(String, Value)> {
    let (name, value) =
        given.split_once('=').with_context(|| format!("{given}: write name=value, as in damping=0.5"))?;
    let values: Result<Vec<f64>, _> =
        value.trim().trim_start_matches('[').trim_end_matches(']').split(',').map(|v| v.trim().parse()).collect();
    match values {
        Ok(values) => Ok((name.trim().to_owned(), Value::Numbers(values))),
        Err(_) if name.trim().starts_with("shape") => {
            Ok((name.trim().to_owned(), Value::Tool(value.trim().to_owned())))
        }
        Err(_) => bail!("{given}: give a number, or numbers as in gravity=[0,0,-9.81]"),
    }
}
