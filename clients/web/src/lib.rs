//! The organ in a browser or a headset: one page and one WebSocket, served beside a Palpate server.
//!
//! A [`Gateway`] is a client of the server, with the zenoh sessions of one, and a process of its own. Browsers cannot
//! speak zenoh; they get messages of the contract over a WebSocket, see [`message`].
//!
//! | module | is |
//! |---|---|
//! | `access` | tokens, cookies, origins, rights |
//! | [`message`] | what goes over the WebSocket |
//! | `frames` | parts of frames to whole frames |
//! | `upstream` | the connection to the server |
//! | `hands` | the tools that a page holds |
//! | `files`, `tls` | the page's files; certificates |
//! | `page` | one WebSocket |
//! | `gateway` | listener and routes |
//!
//! The page itself is in `page/`: modules of JavaScript as they are, no build. Its map stands in `page/main.js`.

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

mod access;
mod args;
mod files;
mod frames;
mod gateway;
mod hands;
pub mod message;
mod page;
mod tls;
mod upstream;

pub use access::Rights;
pub use args::Args;
pub use gateway::{Counters, Gateway, Options};
pub use tls::Tls;
