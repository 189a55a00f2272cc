//! What can go wrong between a client and a server.

use palpate_client::ClientError;

/// Every failure of this crate, worded for the person in front of the client.
#[derive(Debug, thiserror::Error)]
pub enum SdkError {
    /// No zenoh session could be opened to this endpoint.
    #[error("cannot connect to {endpoint}: {reason}")]
    Connect {
        /// The endpoint, as given.
        endpoint: String,
        /// What zenoh says.
        reason: String,
    },
    /// The certificate of this client cannot be read, or there is none where one is asked for.
    #[error("identity: {0}")]
    Identity(String),
    /// Nobody who asks for certificates takes this client's, and has one that it takes.
    #[error(
        "cannot connect to {endpoint}: no server is there, or it does not take the certificate in {folder}, or has none that \
         is good: both are of the same authority (ca.pem), not out of date, and the server's is for the host of the endpoint"
    )]
    Certificate {
        /// The endpoint, as given.
        endpoint: String,
        /// This client's identity.
        folder: String,
    },
    /// The session name is not one key chunk.
    #[error("'{0}' cannot be a session name: use letters, digits, '-' and '_'")]
    SessionName(String),
    /// The connection was opened for the surface only.
    #[error("this connection has no force channel: open it with Connection::open")]
    NoForceChannel,
    /// zenoh refused an operation of this client, usually because the session is closed.
    #[error("cannot {operation} {key}: {reason}")]
    Zenoh {
        /// What was tried, as a verb.
        operation: &'static str,
        /// On which key expression.
        key: String,
        /// What zenoh says.
        reason: String,
    },
    /// Connected, but nobody answered a query.
    #[error("no answer on {key} from {endpoint}: is a Palpate server of this session name there?")]
    NoAnswer {
        /// The key that was asked.
        key: String,
        /// The endpoint it was asked through.
        endpoint: String,
    },
    /// The server knows the certificate's maker, and no role for its name.
    #[error("the server has no role for the name of this certificate: it has to stand in the server's roles file")]
    NoRole,
    /// This client's role does not include a request.
    #[error("{name} is {role} on this server, and may not {action}")]
    Role {
        /// Of the certificate.
        name: String,
        /// As the server calls it.
        role: String,
        /// One of [`ACTIONS`](palpate_proto::keys::ACTIONS).
        action: &'static str,
    },
    /// The server answered a request with an error.
    #[error("the server refused: {0}")]
    Refused(String),
    /// The server speaks another version of the contract, or an earlier one than this needs.
    #[error("the server speaks version {server} of the contract, this client version {client}")]
    Version {
        /// Version of the server, `major` or `major.minor`.
        server: String,
        /// Version of this client.
        client: String,
    },
    /// The tool is no longer this client's: it was freed or taken, or the server or the network is away.
    #[error("the tool is gone: nothing has come of it for {silence_s:.1} s, or somebody else holds it. Attach again")]
    ToolGone {
        /// Age of its newest wrench [s].
        silence_s: f64,
    },
    /// A name, a file, numbers or a message that make no sense.
    #[error(transparent)]
    Client(#[from] ClientError),
}

/// What zenoh says, without the place in its source code that it appends to every message as ` at <file>.rs:<line>.`
pub(crate) fn reason(error: zenoh::Error) -> String {
    let text = error.to_string();
    match text.rsplit_once(" at ") {
        Some((message, place)) if place.contains(".rs:") => message.to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_names_no_source_file_of_zenoh() {
        assert_eq!(reason("Timeout! at /src/zenoh/orchestrator.rs:388.".into()), "Timeout!");
        assert_eq!(reason("nobody is at home".into()), "nobody is at home");
    }
}
