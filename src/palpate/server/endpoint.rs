//! Where a server listens: checked before a body is built for it, and who can reach it.

use super::ServerError;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};

/// Who can reach an endpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Programs on this machine.
    ThisMachine,
    /// Whoever can reach this machine.
    Others,
}

/// Who can reach `endpoint`, the value of the option `option`, when it is listened on.
///
/// # Errors
/// [`ServerError::Listen`]: it is none, or it cannot be listened on now.
pub fn reach(endpoint: &str, option: &'static str) -> Result<Reach, ServerError> {
    let refused = |reason: String| ServerError::Listen { endpoint: endpoint.to_owned(), option, reason };
    let address =
        endpoint.strip_prefix("tcp/").ok_or_else(|| refused("this is no endpoint: it begins with tcp/".into()))?;
    // zenoh's own settings of a link stand behind the address.
    let address = address.split(['?', '#']).next().unwrap_or_default();
    let places: Vec<SocketAddr> = address.to_socket_addrs().map_err(|e| refused(e.to_string()))?.collect();
    for place in &places {
        TcpListener::bind(place).map_err(|e| refused(e.to_string()))?;
    }
    let is_local = places.iter().all(|place| place.ip().to_canonical().is_loopback());
    Ok(if is_local { Reach::ThisMachine } else { Reach::Others })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_address_of_the_loopback_is_reachable_from_this_machine_alone() {
        let of = |endpoint: &str| reach(endpoint, "--force-endpoint");
        for local in ["tcp/127.0.0.1:0", "tcp/127.8.9.10:0", "tcp/localhost:0", "tcp/127.0.0.1:0#so_sndbuf=65000"] {
            assert_eq!(of(local).unwrap(), Reach::ThisMachine, "{local}");
        }
        for open in ["tcp/0.0.0.0:0", "tcp/0.0.0.0:0#iface=lo127.0"] {
            assert_eq!(of(open).unwrap(), Reach::Others, "{open}");
        }
        // No address of this machine, though it looks like one.
        for refused in ["tcp/10.127.0.5:0", "tls/127.0.0.1:0", "127.0.0.1:0", "tcp/127.0.0.1", "tcp/", "nonsense"] {
            let e = of(refused).unwrap_err().to_string();
            assert!(e.contains(refused) && e.contains("Remedy") && !e.contains(".rs"), "{e}");
        }
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let e = of(&format!("tcp/{}", taken.local_addr().unwrap())).unwrap_err().to_string();
        assert!(e.contains("another program"), "{e}");
    }
}
