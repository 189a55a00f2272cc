//! How a command that serves ends: by which signal, and with which exit code.

use palpate::tell;
use palpate_proto as proto;
use std::process::ExitCode;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

/// Exit code: all that could be done was done, but something is missing. A recording that is replayed ends early; a server
/// was degraded.
pub const INCOMPLETE: u8 = 3;
/// Exit code: a server could not go on.
const FAILED: u8 = 4;
/// Exit codes of signals are their numbers above this, as in a shell.
const OF_SIGNALS: i32 = 128;

/// The first signal that asked the process to end; a second one ends it at once. What would else kill it, a file that may not
/// grow, becomes an error of whoever writes.
///
/// # Errors
/// The system takes no handlers of signals.
pub fn listen() -> std::io::Result<watch::Receiver<Option<i32>>> {
    // Once there is a handler the signal does nothing more.
    drop(signal(SignalKind::from_raw(libc::SIGXFSZ))?);
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let mut hangup = signal(SignalKind::hangup())?;
    let (first, asked) = watch::channel(None);
    tokio::spawn(async move {
        loop {
            let number = tokio::select! {
                Some(()) = interrupt.recv() => libc::SIGINT,
                Some(()) = terminate.recv() => libc::SIGTERM,
                Some(()) = hangup.recv() => libc::SIGHUP,
                else => return,
            };
            if first.borrow().is_some() {
                tell!("palpate: a second signal: it ends at once");
                std::process::exit(OF_SIGNALS + number);
            }
            tracing::info!(signal = number, "asked to end");
            first.send_replace(Some(number));
        }
    });
    Ok(asked)
}

/// Comes back with the first signal.
pub async fn asked(signals: &watch::Receiver<Option<i32>>) {
    // Without a sender nobody will ask any more.
    if signals.clone().wait_for(Option::is_some).await.is_err() {
        std::future::pending().await
    }
}

/// Of a server that has stopped with `status`, after `signal` if there was one: a terminal that was closed is told from an end
/// that somebody asked for.
pub fn exit_code(status: &proto::Status, signal: Option<i32>) -> ExitCode {
    match (status.health(), signal) {
        (proto::Health::Failed, _) => ExitCode::from(FAILED),
        (proto::Health::Degraded, _) => ExitCode::from(INCOMPLETE),
        (_, Some(libc::SIGHUP)) => ExitCode::from((OF_SIGNALS + libc::SIGHUP) as u8),
        _ => ExitCode::SUCCESS,
    }
}
