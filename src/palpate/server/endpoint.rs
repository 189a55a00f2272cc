//! Where a server listens: checked before a body is built for it, and who can reach it.

use super::roles::{Clients, Trust};
use super::router::Router;
use super::{FORCE_OPTION, Options, ROUTER_OPTION, SURFACE_OPTION, ServerError};
use std::net::{SocketAddr, TcpListener, ToSocketAddrs, UdpSocket};
use std::path::Path;

/// Who can reach an endpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Programs on this machine.
    ThisMachine,
    /// Whoever can reach this machine.
    Others,
}

/// How clients come to an endpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transport {
    Tcp,
    /// With certificates: TLS 1.3 over UDP.
    Quic,
    /// A file of this machine, whose permissions say who may connect.
    UnixSocket,
}

/// Who can reach a server with `options`, when it listens. What its network is told is tried, so that nothing is found wrong with
/// it when a body has been built.
///
/// # Errors
/// [`ServerError::Listen`]: an endpoint is none, or cannot be listened on now. [`ServerError::Trust`]: it would let in whom it
/// knows nothing of. [`ServerError::Router`]: a router is no endpoint. [`ServerError::Identity`], [`ServerError::ZenohConfig`]: such a file cannot be used.
pub fn check(options: &Options) -> Result<Reach, ServerError> {
    let mut all = Reach::ThisMachine;
    for (endpoint, option) in [(&options.force_endpoint, FORCE_OPTION), (&options.surface_endpoint, SURFACE_OPTION)] {
        let (transport, reach) = look_at(endpoint, option)?;
        let is_quic = transport == Transport::Quic;
        let reason = match options.trust {
            Trust::Certificates { .. } if !is_quic => {
                "only QUIC asks for certificates. Remedy: an endpoint as in quic/127.0.0.1:7447"
            }
            Trust::ThisMachine | Trust::Insecure if is_quic => {
                "QUIC needs certificates. Remedy: --identity and --roles; `palpate certificates` makes the former for the \
                 latter"
            }
            Trust::ThisMachine if reach == Reach::Others => {
                "whoever reaches it could move tools, reset the body and record, as nobody is asked who they are. Remedy: \
                 quic/ in place of tcp/, with --identity and --roles, see `palpate certificates`; or --insecure, in a \
                 network where everybody may"
            }
            _ if reach == Reach::Others => {
                all = Reach::Others;
                continue;
            }
            _ => continue,
        };
        return Err(ServerError::Trust { endpoint: endpoint.clone(), option, reason });
    }
    for router in &options.routers {
        if router.parse::<zenoh::config::EndPoint>().is_err() {
            return Err(ServerError::Router(router.clone()));
        }
        let reason = match options.trust {
            Trust::ThisMachine => {
                "whoever reaches that router could move tools, reset the body and record. Remedy: quic/ in place of tcp/, with \
                 --identity and --roles; or --insecure, in a network where everybody may"
            }
            Trust::Certificates { .. } if !router.starts_with("quic/") => {
                "only QUIC asks for certificates. Remedy: a router as in quic/192.168.0.2:7447"
            }
            _ => continue,
        };
        return Err(ServerError::Trust { endpoint: router.clone(), option: ROUTER_OPTION, reason });
    }
    if !options.routers.is_empty() {
        all = Reach::Others;
    }
    Router::new(options, &Clients::default())?;
    Ok(all)
}

/// How clients come to `endpoint`, the value of the option `option`, and who can, when it is listened on.
fn look_at(endpoint: &str, option: &'static str) -> Result<(Transport, Reach), ServerError> {
    let refused = |reason: String| ServerError::Listen { endpoint: endpoint.to_owned(), option, reason };
    let transport = match endpoint.split_once('/').map_or(endpoint, |(scheme, _)| scheme) {
        "tcp" => Transport::Tcp,
        "quic" => Transport::Quic,
        "unixsock-stream" => Transport::UnixSocket,
        // zenoh 1.10 reads and writes the state of a TLS connection on two threads without a lock, and aborts under load.
        "tls" => return Err(refused("TLS over TCP is not safe in zenoh; quic/ is TLS over UDP".into())),
        _ => return Err(refused("this is no endpoint: it begins with tcp/, quic/ or unixsock-stream/".into())),
    };
    let place = endpoint.split_once('/').map_or("", |(_, place)| place);
    // zenoh's own settings of a link stand behind the address.
    let (address, settings) = place.split_at(place.find(['?', '#']).unwrap_or(place.len()));
    match transport {
        Transport::UnixSocket => {
            let folder = Path::new(address).parent().filter(|folder| folder.is_dir());
            folder.ok_or_else(|| refused("there is no such folder".into()))?;
            return Ok((transport, Reach::ThisMachine));
        }
        Transport::Quic if !settings.is_empty() => {
            return Err(refused("its settings are those of the certificates: leave out ? and #".into()));
        }
        Transport::Tcp | Transport::Quic => {}
    }
    let places: Vec<SocketAddr> = address.to_socket_addrs().map_err(|e| refused(e.to_string()))?.collect();
    for place in &places {
        let bound = match transport {
            Transport::Quic => UdpSocket::bind(place).map(drop),
            _ => TcpListener::bind(place).map(drop),
        };
        bound.map_err(|e| refused(e.to_string()))?;
    }
    let is_local = places.iter().all(|place| place.ip().to_canonical().is_loopback());
    Ok((transport, if is_local { Reach::ThisMachine } else { Reach::Others }))
}

#[cfg(test)]
mod tests {
    use super::super::Roles;
    use super::*;
    use palpate_proto::identity;

    /// Of a server that listens on `endpoint` with all that it has.
    fn of(endpoint: &str, trust: &Trust) -> Result<Reach, ServerError> {
        let trust = trust.clone();
        check(&Options {
            force_endpoint: endpoint.into(),
            surface_endpoint: endpoint.into(),
            trust,
            ..Options::default()
        })
    }

    #[test]
    fn only_an_address_of_the_loopback_is_reachable_from_this_machine_alone() {
        let of = |endpoint: &str| of(endpoint, &Trust::Insecure);
        let folder = tempfile::tempdir().unwrap();
        let socket = format!("unixsock-stream/{}", folder.path().join("palpate").display());
        for local in
            ["tcp/127.0.0.1:0", "tcp/127.8.9.10:0", "tcp/localhost:0", "tcp/127.0.0.1:0#so_sndbuf=65000", &socket]
        {
            assert_eq!(of(local).unwrap(), Reach::ThisMachine, "{local}");
        }
        for open in ["tcp/0.0.0.0:0", "tcp/0.0.0.0:0#iface=lo127.0"] {
            assert_eq!(of(open).unwrap(), Reach::Others, "{open}");
        }
        // The first looks like an address of this machine.
        for refused in [
            "tcp/10.127.0.5:0",
            "tls/127.0.0.1:0",
            "127.0.0.1:0",
            "tcp/127.0.0.1",
            "tcp/",
            "unixsock-stream//nowhere/palpate",
            "nonsense",
        ] {
            let e = of(refused).unwrap_err().to_string();
            assert!(e.contains(refused) && e.contains("Remedy") && !e.contains(".rs"), "{e}");
        }
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let e = of(&format!("tcp/{}", taken.local_addr().unwrap())).unwrap_err().to_string();
        assert!(e.contains("another program"), "{e}");
    }

    #[test]
    fn others_are_let_in_with_certificates_or_where_it_is_said_that_everybody_may() {
        let folder = tempfile::tempdir().unwrap();
        let files = [identity::AUTHORITY, identity::CERTIFICATE, identity::KEY, "roles.toml"];
        files.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        let roles = Roles::read(&folder.path().join("roles.toml")).unwrap();
        let certificates = Trust::Certificates { identity: folder.path().into(), roles: roles.clone() };
        assert_eq!(of("tcp/127.0.0.1:0", &Trust::ThisMachine).unwrap(), Reach::ThisMachine);
        assert_eq!(of("tcp/0.0.0.0:0", &Trust::Insecure).unwrap(), Reach::Others);
        assert_eq!(of("quic/0.0.0.0:0", &certificates).unwrap(), Reach::Others);
        let elsewhere = Trust::Certificates { identity: "nowhere".into(), roles };
        assert!(of("quic/0.0.0.0:0", &elsewhere).unwrap_err().to_string().contains("nowhere/ca.pem"));
        for (endpoint, trust, remedy) in [
            ("tcp/0.0.0.0:0", &Trust::ThisMachine, "--insecure"),
            ("tcp/0.0.0.0:0", &certificates, "quic/"),
            ("tcp/127.0.0.1:0", &certificates, "quic/"),
            ("quic/127.0.0.1:0", &Trust::ThisMachine, "--roles"),
            ("quic/127.0.0.1:0#enable_mtls=false", &certificates, "leave out"),
        ] {
            let e = of(endpoint, trust).unwrap_err().to_string();
            assert!(e.contains(endpoint) && e.contains("Remedy") && e.contains(remedy), "{e}");
        }
    }
}
