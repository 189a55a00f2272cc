//! `palpate list`: the servers that a server or a zenoh router knows.

use clap::Args;
use palpate::say;
use palpate_proto::keys;
use std::path::PathBuf;
use std::process::ExitCode;

/// `palpate list`.
#[derive(Args)]
pub struct ListArgs {
    /// A server's surface endpoint, or a router's
    #[arg(long, value_name = "ENDPOINT", default_value = keys::DEFAULT_SURFACE_ENDPOINT)]
    connect: String,
    /// Folder of your certificate, where the server asks for one
    #[arg(long, value_name = "FOLDER")]
    identity: Option<PathBuf>,
}

/// A line for each server: its session, its body, and its tools, which may be taken.
pub fn run(args: &ListArgs) -> anyhow::Result<ExitCode> {
    for session in palpate_sdk::sessions(&args.connect, args.identity.as_deref())? {
        let endpoints = palpate_sdk::Endpoints {
            surface: args.connect.clone(),
            session: session.clone(),
            identity: args.identity.clone(),
            ..Default::default()
        };
        // One that has just ended answers no more: it is left out.
        let Ok(found) = palpate_sdk::Connection::open_surface(&endpoints)?.session() else { continue };
        let state = |taken| if taken { "taken" } else { "free" };
        let tools = found.tools.iter().map(|tool| format!("{} ({})", tool.name, state(tool.taken)));
        let body = found.body.unwrap_or_default().name;
        say!("{session}: {body}; {}", tools.collect::<Vec<_>>().join(", "))?;
    }
    Ok(ExitCode::SUCCESS)
}
