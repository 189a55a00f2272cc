//! `palpate web`: a page and one WebSocket, as a process of its own beside a server.

use crate::{LogFormat, log_to_stderr, runtime};
use clap::Args;
use palpate::{say, tell};
use palpate_web::{Gateway, Options, Rights};
use std::io::IsTerminal;
use std::process::{Command, ExitCode, Stdio};
use std::sync::atomic::Ordering::Relaxed;

#[derive(Args)]
pub struct WebArgs {
    #[command(flatten)]
    gateway: palpate_web::Args,
    /// Open the page in a browser of this machine, where it has a display
    #[arg(long)]
    open: bool,
}

pub fn run(args: WebArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr(LogFormat::Text);
    let view_only = args.gateway.view_only;
    runtime()?.block_on(async {
        let gateway = Gateway::start(Options::from(args.gateway)).await?;
        if let Some(fingerprint) = gateway.fingerprint() {
            say!("certificate, SHA-256: {fingerprint}")?;
        }
        let address = invite(&gateway, view_only)?;
        if args.open && display_is_named() {
            open(&address);
        }
        let mut lines = lines();
        let mut terminate = terminated()?;
        loop {
            tokio::select! {
                Some(()) = lines.recv() => drop(invite(&gateway, view_only)?),
                _ = terminate.recv() => break,
                interrupted = tokio::signal::ctrl_c() => {
                    interrupted?;
                    break;
                }
            }
        }
        let counters = gateway.counters();
        let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Relaxed);
        tell!(
            "{} frames sent, {} missed by slow pages; {} poses, {} superseded, {} refused; {} sockets refused, {} \
             messages that were none",
            count(&counters.frames),
            count(&counters.frames_missed),
            count(&counters.poses),
            count(&counters.poses_superseded),
            count(&counters.poses_refused),
            count(&counters.pages_refused),
            count(&counters.malformed)
        );
        gateway.stop().await;
        Ok(ExitCode::SUCCESS)
    })
}

/// Prints addresses that let one browser in each; gives that of the greatest rights.
fn invite(gateway: &Gateway, view_only: bool) -> anyhow::Result<String> {
    let watch = gateway.invite(Rights::Viewer);
    let address = if view_only { watch.clone() } else { gateway.invite(Rights::Operator) };
    if !view_only {
        say!("to touch: {address}")?;
    }
    say!("to watch: {watch}")?;
    let more = if std::io::stdin().is_terminal() { "; Enter makes fresh ones" } else { "" };
    tell!("each address lets one browser in, once{more}; Ctrl-C ends it");
    Ok(address)
}

/// A word for each line that somebody enters in the terminal.
fn lines() -> tokio::sync::mpsc::Receiver<()> {
    let (entered, lines) = tokio::sync::mpsc::channel(1);
    if std::io::stdin().is_terminal() {
        // A thread of its own, that nobody joins: a read of standard input cannot be called off.
        std::thread::spawn(move || {
            for line in std::io::stdin().lines() {
                if line.is_err() || entered.blocking_send(()).is_err() {
                    break;
                }
            }
        });
    }
    lines
}

fn terminated() -> std::io::Result<tokio::signal::unix::Signal> {
    tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate())
}

fn display_is_named() -> bool {
    ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}

/// The desktop knows which browser. Where there is none the address stands in the terminal.
fn open(address: &str) {
    let opener = Command::new("xdg-open").arg(address).stdin(Stdio::null()).stderr(Stdio::null()).spawn();
    if opener.is_err() {
        tell!("no browser opens by itself: open the first address");
    }
}
