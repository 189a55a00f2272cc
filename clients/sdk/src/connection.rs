//! The connection to a server: two zenoh sessions, so that no mesh ever stands before a force.

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use palpate_client::ClientError;
use palpate_proto::{
    CONTROL_MINOR, ControlReply, ControlRequest, Message, Parameter, Role, Session, SetParameters, Status,
    VERSION_MAJOR, VERSION_MINOR,
    control_request::Request,
    identity,
    keys::{self, DEFAULT_FORCE_ENDPOINT, DEFAULT_SESSION, DEFAULT_SURFACE_ENDPOINT},
};
use zenoh::{
    Wait,
    bytes::ZBytes,
    pubsub::{Publisher, Subscriber},
    qos::{CongestionControl, Priority},
};

use crate::{SdkError, error::reason};

/// How long a query may take.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// How long to wait before a query that nobody takes is sent again.
const ASK_AGAIN: Duration = Duration::from_millis(50);

/// Where a server is and how it is called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoints {
    /// zenoh endpoint of the force channel, such as `quic/192.168.0.2:7447`.
    pub force: String,
    /// zenoh endpoint of surface, session, control, presence and status.
    pub surface: String,
    /// Session name of the server.
    pub session: String,
    /// Folder of this client's certificate, where the server asks for one: see [`identity`].
    pub identity: Option<PathBuf>,
}

impl Default for Endpoints {
    /// A server on this machine that was started without arguments.
    fn default() -> Self {
        Self {
            force: DEFAULT_FORCE_ENDPOINT.to_owned(),
            surface: DEFAULT_SURFACE_ENDPOINT.to_owned(),
            session: DEFAULT_SESSION.to_owned(),
            identity: None,
        }
    }
}

/// An open connection. Clones share it; it closes with the last clone and the last [`Tool`](crate::Tool).
#[derive(Clone)]
pub struct Connection {
    endpoints: Endpoints,
    force: Option<zenoh::Session>,
    surface: zenoh::Session,
    opened: Instant,
}

/// A running subscription; it ends when this is dropped.
pub struct Subscription {
    _subscriber: Subscriber<()>,
    // Last, so that the subscription goes before its session closes.
    _connection: Connection,
}

impl Connection {
    /// Connects to both endpoints; gives up after 5 s each.
    ///
    /// Threads that zenoh starts inherit the scheduling class of the calling thread, see the crate documentation.
    /// Errors: [`SdkError::SessionName`], [`SdkError::Connect`], [`SdkError::Identity`], [`SdkError::Certificate`].
    pub fn open(endpoints: &Endpoints) -> Result<Self, SdkError> {
        check_session_name(endpoints)?;
        let force = open_session(&endpoints.force, endpoints.identity.as_deref())?;
        Self::with_force(endpoints, Some(force))
    }

    /// Connects to the surface endpoint only: enough to look, not to touch. Errors as [`open`](Self::open).
    pub fn open_surface(endpoints: &Endpoints) -> Result<Self, SdkError> {
        check_session_name(endpoints)?;
        Self::with_force(endpoints, None)
    }

    fn with_force(endpoints: &Endpoints, force: Option<zenoh::Session>) -> Result<Self, SdkError> {
        let surface = open_session(&endpoints.surface, endpoints.identity.as_deref())?;
        Ok(Self { endpoints: endpoints.clone(), force, surface, opened: Instant::now() })
    }

    /// Where this connection leads.
    pub fn endpoints(&self) -> &Endpoints {
        &self.endpoints
    }

    /// Time since the connection was opened [ns], monotonic: the clock of every `time_ns` and `arrival_ns`.
    pub fn now_ns(&self) -> u64 {
        nanoseconds_since(self.opened)
    }

    /// What the server simulates, which tools it has and how far they may go.
    ///
    /// Errors: [`SdkError::NoAnswer`] after 2 s, [`SdkError::NoRole`], [`SdkError::Version`] when the server speaks another
    /// contract.
    pub fn session(&self) -> Result<Session, SdkError> {
        let answer = self.ask(keys::session(&self.endpoints.session), None, "Session");
        let session: Session = answer.map_err(|error| {
            // A server passes on no question of a client without a role, but for that of its role.
            let roles = self.ask_once(keys::all_roles(&self.endpoints.session), None, "Role");
            roles.ok().and_then(|roles| named(roles).err()).unwrap_or(error)
        })?;
        if session.version_major != VERSION_MAJOR {
            let (server, client) = (session.version_major.to_string(), VERSION_MAJOR.to_string());
            return Err(SdkError::Version { server, client });
        }
        Ok(session)
    }

    /// What this client may do.
    ///
    /// Errors: [`SdkError::NoRole`], [`SdkError::Version`] when the server's contract knows no roles, [`SdkError::NoAnswer`]
    /// after 2 s.
    pub fn role(&self) -> Result<Role, SdkError> {
        match self.ask_all(keys::all_roles(&self.endpoints.session), None, "Role") {
            Ok(roles) => named(roles),
            Err(no_answer @ SdkError::NoAnswer { .. }) => match self.session()?.version_minor {
                minor if minor < CONTROL_MINOR => Err(SdkError::Version {
                    server: format!("{VERSION_MAJOR}.{minor}"),
                    client: format!("{VERSION_MAJOR}.{VERSION_MINOR}"),
                }),
                _ => Err(no_answer),
            },
            Err(error) => Err(error),
        }
    }

    /// Has the server carry out a request.
    ///
    /// Errors: [`SdkError::Role`] where this client may not ask for it, [`SdkError::Refused`] with the server's reason, and
    /// those of [`role`](Self::role).
    pub fn control(&self, request: Request) -> Result<ControlReply, SdkError> {
        let action = keys::action(&request);
        let Role { name, role, actions, .. } = self.role()?;
        if actions.iter().all(|allowed| allowed != action) {
            return Err(SdkError::Role { name, role, action });
        }
        let payload = ControlRequest { request: Some(request) }.encode_to_vec().into();
        let key = keys::control(&self.endpoints.session, action, &name);
        let reply: ControlReply = self.ask(key, Some(payload), "ControlReply")?;
        if reply.error.is_empty() { Ok(reply) } else { Err(SdkError::Refused(reply.error)) }
    }

    /// Sets parameters of the simulation by name, as [`Session::parameters`] lists them with their ranges: all of them or, where
    /// one is refused, none. They enter ticks one after another, are recorded, and are there again in a replay.
    ///
    /// Errors: as [`control`](Self::control); [`SdkError::Refused`] names the parameter and its range.
    pub fn set_parameters(&self, parameters: impl IntoIterator<Item = (String, Vec<f64>)>) -> Result<(), SdkError> {
        let parameters = parameters.into_iter().map(|(name, values)| Parameter { name, values }).collect();
        self.control(Request::Set(SetParameters { parameters })).map(|_| ())
    }

    /// Asks one queryable of the surface endpoint and decodes its only answer.
    fn ask<M: Message + Default>(
        &self,
        key: String,
        payload: Option<ZBytes>,
        message: &'static str,
    ) -> Result<M, SdkError> {
        let first = self.ask_all(key, payload, message)?.into_iter().next();
        first.ok_or_else(|| ClientError::Undecodable { message, reason: "it is no answer".to_owned() }.into())
    }

    /// Asks one queryable of the surface endpoint and decodes its answers, at least one, each on a key of its own.
    ///
    /// A server that has just come up takes connections before it offers its keys: where nobody does, it is asked again, and so
    /// is one that is busy.
    pub(crate) fn ask_all<M: Message + Default>(
        &self,
        key: String,
        payload: Option<ZBytes>,
        message: &'static str,
    ) -> Result<Vec<M>, SdkError> {
        let begun = Instant::now();
        loop {
            let answer = self.ask_once(key.clone(), payload.clone(), message);
            match answer {
                Err(SdkError::NoAnswer { .. }) if begun.elapsed() < ANSWER_TIMEOUT => std::thread::sleep(ASK_AGAIN),
                Err(SdkError::Refused(why)) if why.starts_with("busy") && begun.elapsed() < ANSWER_TIMEOUT => {
                    std::thread::sleep(ASK_AGAIN);
                }
                _ => return answer,
            }
        }
    }

    /// [`Connection::ask_all`], which gives up at once where nobody offers the key.
    pub(crate) fn ask_once<M: Message + Default>(
        &self,
        key: String,
        payload: Option<ZBytes>,
        message: &'static str,
    ) -> Result<Vec<M>, SdkError> {
        let mut query = self.surface.get(&key).timeout(ANSWER_TIMEOUT);
        if let Some(payload) = payload {
            query = query.payload(payload);
        }
        let replies = query.wait().map_err(|error| SdkError::Zenoh {
            operation: "ask",
            key: key.clone(),
            reason: reason(error),
        })?;
        let no_answer = || SdkError::NoAnswer { key: key.clone(), endpoint: self.endpoints.surface.clone() };
        let undecodable = |reason: String| SdkError::Client(ClientError::Undecodable { message, reason });
        let mut answers = Vec::new();
        // The channel closes after the last reply; without any when nobody offers this key.
        while let Ok(reply) = replies.recv() {
            match reply.result() {
                Ok(sample) => {
                    answers.push(M::decode(&*sample.payload().to_bytes()).map_err(|e| undecodable(e.to_string()))?);
                }
                Err(error) => match error.payload().try_to_string() {
                    // zenoh reports its own time limit as an error reply with this text.
                    Ok(text) if text == "Timeout" => return Err(no_answer()),
                    Ok(text) => return Err(SdkError::Refused(text.into_owned())),
                    Err(error) => return Err(undecodable(error.to_string())),
                },
            }
        }
        if answers.is_empty() { Err(no_answer()) } else { Ok(answers) }
    }

    /// Calls `callback` with the server's status, once a second. It runs on a receiving thread of zenoh and must return
    /// quickly. Messages that are no status are left out. Errors: [`SdkError::Zenoh`].
    pub fn subscribe_status(
        &self,
        callback: impl Fn(Status) + Send + Sync + 'static,
    ) -> Result<Subscription, SdkError> {
        self.subscribe(keys::status(&self.endpoints.session), callback)
    }

    /// Calls `callback` with every message of the type `M` that comes on `key` of the surface endpoint.
    pub(crate) fn subscribe<M: Message + Default>(
        &self,
        key: String,
        callback: impl Fn(M) + Send + Sync + 'static,
    ) -> Result<Subscription, SdkError> {
        let subscriber = self
            .surface
            .declare_subscriber(&key)
            .callback(move |sample| {
                if let Ok(message) = M::decode(&*sample.payload().to_bytes()) {
                    callback(message);
                }
            })
            .wait()
            .map_err(|error| SdkError::Zenoh { operation: "subscribe to", key, reason: reason(error) })?;
        Ok(Subscription { _subscriber: subscriber, _connection: self.clone() })
    }

    /// The force session. Errors: [`SdkError::NoForceChannel`] where the connection was opened for viewing.
    pub(crate) fn force_session(&self) -> Result<&zenoh::Session, SdkError> {
        self.force.as_ref().ok_or(SdkError::NoForceChannel)
    }

    pub(crate) fn surface_session(&self) -> &zenoh::Session {
        &self.surface
    }

    pub(crate) fn opened(&self) -> Instant {
        self.opened
    }
}

/// Nanoseconds from `instant` until now; 584 years fit.
pub(crate) fn nanoseconds_since(instant: Instant) -> u64 {
    instant.elapsed().as_nanos() as u64
}

/// A publisher on the force channel whose messages go out at once or not at all.
pub(crate) fn realtime_publisher(force: &zenoh::Session, key: String) -> Result<Publisher<'static>, SdkError> {
    force
        .declare_publisher(key.clone())
        .priority(Priority::RealTime)
        .express(true)
        .congestion_control(CongestionControl::Drop)
        .wait()
        .map_err(|error| SdkError::Zenoh { operation: "publish on", key, reason: reason(error) })
}

/// The one of `roles` that is the asker's.
fn named(roles: Vec<Role>) -> Result<Role, SdkError> {
    roles.into_iter().find(|role| !role.role.is_empty()).ok_or(SdkError::NoRole)
}

fn check_session_name(endpoints: &Endpoints) -> Result<(), SdkError> {
    if keys::is_name(&endpoints.session) { Ok(()) } else { Err(SdkError::SessionName(endpoints.session.clone())) }
}

/// Names of the sessions of all servers that can be reached at `endpoint`, a server's surface endpoint or that of a zenoh router;
/// in their order. Errors: [`SdkError::Connect`], [`SdkError::Zenoh`].
pub fn sessions(endpoint: &str, folder: Option<&Path>) -> Result<Vec<String>, SdkError> {
    let (session, key) = (open_session(endpoint, folder)?, keys::session("*"));
    let tokens = session.liveliness().get(&key).timeout(ANSWER_TIMEOUT).wait().map_err(|error| SdkError::Zenoh {
        operation: "look for",
        key: key.clone(),
        reason: reason(error),
    })?;
    let name = |key: &str| key.split('/').nth_back(1).unwrap_or_default().to_owned();
    let mut names: Vec<String> = std::iter::from_fn(|| tokens.recv().ok())
        .filter_map(|token| Some(name(token.result().ok()?.key_expr())))
        .collect();
    names.sort();
    names.dedup();
    Ok(names)
}

fn open_session(endpoint: &str, folder: Option<&Path>) -> Result<zenoh::Session, SdkError> {
    if is_secured(endpoint) && !cfg!(feature = "certificates") {
        let fault = "asks for a certificate, and this library was built without the feature `certificates`";
        return Err(SdkError::Identity(format!("{endpoint} {fault}")));
    }
    let certificates = match folder {
        Some(folder) => identity::settings(folder).map_err(SdkError::Identity)?,
        None if is_secured(endpoint) => {
            return Err(SdkError::Identity(format!("{endpoint} asks for a certificate, and none was given")));
        }
        None => Vec::new(),
    };
    let opened = client_config(endpoint, certificates).and_then(|config| zenoh::open(config).wait());
    opened.map_err(|error| match folder {
        // zenoh tells of a time limit alone.
        Some(folder) if is_secured(endpoint) => {
            SdkError::Certificate { endpoint: endpoint.to_owned(), folder: folder.display().to_string() }
        }
        _ => SdkError::Connect { endpoint: endpoint.to_owned(), reason: reason(error) },
    })
}

/// True where both ends show certificates.
fn is_secured(endpoint: &str) -> bool {
    endpoint.starts_with("quic/")
}

fn client_config(endpoint: &str, certificates: Vec<(String, String)>) -> zenoh::Result<zenoh::Config> {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", r#""client""#),
        ("connect/endpoints", &format!("[{endpoint:?}]")),
        // Retry for a while, so that client and server may be started together; then report instead of waiting on.
        ("connect/timeout_ms", "5000"),
        ("connect/exit_on_failure", "true"),
        ("connect/retry", "{ period_init_ms: 100, period_max_ms: 1000 }"),
        ("listen/endpoints", "[]"),
        ("scouting/multicast/enabled", "false"),
        // A frozen client loses its presence after this long (the default is 10 s).
        ("transport/link/tx/lease", "2000"),
        // A pose that cannot leave now is better replaced by the next one than sent late.
        ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "0"),
    ] {
        config.insert_json5(key, value)?;
    }
    for (key, value) in certificates {
        config.insert_json5(&key, &value)?;
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_client_configuration_is_accepted_by_zenoh() {
        let config = client_config("tcp/127.0.0.1:7447", vec![]).unwrap();
        assert_eq!(config.get_json("mode").unwrap(), r#""client""#);
        assert!(config.get_json("connect/endpoints").unwrap().contains("tcp/127.0.0.1:7447"));
    }

    #[test]
    fn a_bad_session_name_is_refused_before_connecting() {
        let endpoints = Endpoints { session: "a/b".to_owned(), ..Endpoints::default() };
        let error = Connection::open(&endpoints).err().unwrap();
        assert_eq!(error.to_string(), "'a/b' cannot be a session name: use letters, digits, '-' and '_'");
    }

    #[test]
    #[cfg(not(feature = "certificates"))]
    fn an_endpoint_that_asks_for_a_certificate_is_refused_in_words_where_the_library_has_none() {
        let endpoints = Endpoints { surface: "quic/127.0.0.1:7447".to_owned(), ..Endpoints::default() };
        let error = Connection::open_surface(&endpoints).err().unwrap();
        assert!(error.to_string().contains("without the feature `certificates`"), "{error}");
    }

    #[test]
    fn an_endpoint_that_is_none_is_named_in_the_error() {
        let endpoints = Endpoints { surface: "nowhere".to_owned(), ..Endpoints::default() };
        let error = Connection::open_surface(&endpoints).err().unwrap();
        assert!(error.to_string().starts_with("cannot connect to nowhere: "), "{error}");
    }
}
