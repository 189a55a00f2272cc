//! The two zenoh sessions of a server. Each routes for its clients: no router has to run beside it. Routers that do not answer
//! are tried again as long as it lasts, and what passes between them and these is what passes for clients.

use super::access::access;
use super::roles::{Clients, Trust};
use super::{FORCE_OPTION, Options, SURFACE_OPTION, ServerError};
use crate::realtime::scheduling;
use palpate_proto::identity;
use std::path::Path;
use zenoh::{Config, Wait};

/// Connections to the force endpoint, which hands alone need: viewers cannot take their places.
const HANDS: u32 = 64;
/// Connections to the surface endpoint.
const VIEWERS: u32 = 512;

/// What a zenoh configuration file cannot have beside [`settings`]: who is let in, by which way, and what answers beside the
/// server.
const CLOSED: [&str; 11] = [
    "adminspace",
    "connect",
    "listen",
    "namespace",
    "plugins",
    "plugins_loading",
    "scouting",
    "transport/auth",
    "transport/link/protocols",
    "transport/link/tls",
    "transport/link/unixpipe",
];

/// How both sessions are opened.
#[derive(Clone)]
pub(super) struct Router {
    config: Config,
}

impl Router {
    /// For `clients`, with what `options` say beside the endpoints.
    ///
    /// # Errors
    /// [`ServerError::Identity`], [`ServerError::ZenohConfig`].
    pub(super) fn new(options: &Options, clients: &Clients) -> Result<Self, ServerError> {
        let mut settings = settings(access(&options.session, clients));
        if let Trust::Certificates { identity, .. } = &options.trust {
            settings.extend(identity::settings(identity).map_err(ServerError::Identity)?);
        }
        let mut config = match &options.zenoh_config {
            Some(file) => read(file, &settings)?,
            None => Config::default(),
        };
        settings.push(("connect/endpoints".into(), format!("{:?}", options.routers)));
        // One that was away is back within a second or two [ms].
        settings.push(("connect/retry".into(), "{ period_init_ms: 200, period_max_ms: 1000 }".into()));
        for (key, value) in &settings {
            config.insert_json5(key, value).map_err(|e| ServerError::Network(format!("{key}: {}", words(&e))))?;
        }
        Ok(Self { config })
    }

    /// The force session, opened from a real-time thread: zenoh's threads inherit its class.
    pub(super) fn force(&self, options: &Options) -> Result<zenoh::Session, ServerError> {
        let (router, endpoint) = (self.clone(), options.force_endpoint.clone());
        let opened = std::thread::spawn(move || {
            if scheduling::fifo(scheduling::FORCE_NETWORK).is_err() {
                tracing::debug!("the force network's threads run at normal priority");
            }
            router.open(&endpoint, FORCE_OPTION, HANDS)
        });
        opened.join().map_err(|_| ServerError::Network("zenoh panicked while opening".into()))?
    }

    /// The session of everything else.
    pub(super) fn surface(&self, options: &Options) -> Result<zenoh::Session, ServerError> {
        self.open(&options.surface_endpoint, SURFACE_OPTION, VIEWERS)
    }

    /// Listens on `endpoint`; at most `places` may be connected.
    fn open(&self, endpoint: &str, option: &'static str, places: u32) -> Result<zenoh::Session, ServerError> {
        let mut config = self.config.clone();
        for (key, value) in [
            ("listen/endpoints", format!("[{endpoint:?}]")),
            ("transport/unicast/max_sessions", places.to_string()),
            ("transport/unicast/accept_pending", places.to_string()),
        ] {
            config.insert_json5(key, &value).map_err(|e| match key {
                "listen/endpoints" => {
                    let reason = "this is no endpoint".to_owned();
                    ServerError::Listen { endpoint: endpoint.to_owned(), option, reason }
                }
                _ => ServerError::Network(format!("{key}: {}", words(&e))),
            })?;
        }
        zenoh::open(config).wait().map_err(|e| {
            let words = words(&e);
            // The system's words stand last, after the same endpoint twice.
            let reason = words.split_once(": [").map_or(&*words, |(_, list)| list.rsplit(": ").next().unwrap_or(list));
            let reason = reason.trim_end_matches(']').to_owned();
            ServerError::Listen { endpoint: endpoint.to_owned(), option, reason }
        })
    }
}

/// Settings of both sessions: keys, and values in JSON5.
fn settings(access: String) -> Vec<(String, String)> {
    let settings = [
        ("mode", "\"router\""),
        ("listen/exit_on_failure", "true"),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        // There is nobody to look for: without this, opening waits half a second.
        ("scouting/delay", "0"),
        ("timestamping/enabled", "false"),
        ("access_control", &access),
        // Whoever connects and says nothing makes room for others after this long [ms].
        ("transport/unicast/accept_timeout", "1000"),
        // Bytes of a message: a pose has about 60, a request some hundred.
        ("transport/link/rx/max_message_size", "65536"),
        // A client that stops answering is noticed after this long [ms]; safety does not wait for it.
        ("transport/link/tx/lease", "1500"),
        // A message that does not fit the queue at once is dropped: a slow viewer holds up nobody.
        ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "0"),
        // Whoever does not read the answers to its questions is cut off after this long [µs]. Longer, and more threads wait for
        // it; shorter, and a link of less than 2 Mbit/s, which needs as long for a batch, is no link.
        ("transport/link/tx/queue/congestion_control/block/wait_before_close", "250000"),
        // Batches of 64 KiB that may wait for a viewer: a frame of the largest surface has more parts than the default of two.
        ("transport/link/tx/queue/size/data_low", "16"),
    ];
    settings.map(|(key, value)| (key.to_owned(), value.to_owned())).to_vec()
}

/// A zenoh configuration from `file`, which leaves alone what `settings` and [`CLOSED`] name.
fn read(file: &Path, settings: &[(String, String)]) -> Result<Config, ServerError> {
    let refused = |reason: String| ServerError::ZenohConfig { file: file.to_owned(), reason };
    let config = Config::from_file(file).map_err(|e| refused(words(&e)))?;
    let untouched = Config::default();
    let own = settings.iter().map(|(key, _)| key.as_str());
    let own = own.chain(["transport/unicast/max_sessions", "transport/unicast/accept_pending"]).chain(CLOSED);
    for key in own {
        let value = |config: &Config| config.get_json(key).map_err(|e| refused(format!("{key}: {}", words(&e))));
        if value(&config)? != value(&untouched)? {
            return Err(refused(format!("{key} is the server's own, or would let others in: leave it out")));
        }
    }
    Ok(config)
}

pub(super) fn network(e: zenoh::Error) -> ServerError {
    ServerError::Network(words(&e))
}

/// zenoh's message without the places in its source that it appends.
fn words(e: &zenoh::Error) -> String {
    let text = e.to_string();
    text.split(" at ").filter(|part| !part.contains(".rs:")).collect::<Vec<_>>().join(" at ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zenoh_file_passes_but_for_what_the_server_decides_which_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("zenoh.json5");
        let read = |text: &str| {
            std::fs::write(&file, text).unwrap();
            read(&file, &settings(r#"{ "enabled": true }"#.into())).map_err(|e| e.to_string())
        };
        let config = read("{ transport: { link: { tx: { threads: 3 } } } } // a comment").unwrap();
        assert_eq!(config.get_json("transport/link/tx/threads").unwrap(), "3");
        for (text, key) in [
            ("{ access_control: { enabled: true, default_permission: 'allow' } }", "access_control"),
            ("{ mode: 'peer' }", "mode"),
            ("{ listen: { endpoints: ['tcp/0.0.0.0:7000'] } }", "listen"),
            ("{ transport: { link: { tls: { enable_mtls: false } } } }", "transport/link/tls"),
            ("{ transport: { link: { rx: { max_message_size: 1 } } } }", "transport/link/rx/max_message_size"),
            ("{ adminspace: { enabled: true } }", "adminspace"),
            ("{ plugins_loading: { enabled: true } }", "plugins_loading"),
            ("{ transport: { auth: { usrpwd: { user: 'a', password: 'b' } } } }", "transport/auth"),
            ("{ nonsense: 3 }", "nonsense"),
            ("{ mode: ", "zenoh.json5"),
        ] {
            let e = read(text).map(drop).unwrap_err();
            assert!(e.contains(key) && !e.contains(".rs"), "{text}: {e}");
        }
    }
}
