//! Lines for people, on standard output and standard error, whose readers may be gone: `palpate … | head` ends quietly.

use std::fmt;
use std::io::{self, ErrorKind, Write};

/// Writes `text` to standard output. Where nobody reads it any more it is dropped: what else there is to do goes on.
///
/// # Errors
/// When it cannot be written for another reason, as on a full disk.
pub fn say(text: fmt::Arguments) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(e) => Err(io::Error::new(e.kind(), format!("standard output: {e}"))),
        Ok(()) => Ok(()),
    }
}

/// Writes `text` to standard error, where somebody reads it.
pub fn tell(text: fmt::Arguments) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// [`terminal::say`](crate::terminal::say) of a format and its arguments.
#[macro_export]
macro_rules! say {
    ($($text:tt)*) => { $crate::terminal::say(format_args!($($text)*)) };
}

/// [`terminal::tell`](crate::terminal::tell) of a format and its arguments.
#[macro_export]
macro_rules! tell {
    ($($text:tt)*) => { $crate::terminal::tell(format_args!($($text)*)) };
}
