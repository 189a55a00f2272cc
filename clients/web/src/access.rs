//! Who may come in, and with which rights.
//!
//! An address with a token opens the door once: the token is exchanged for a cookie, which the browser shows from then
//! on. An address that was copied, logged or guessed afterwards opens nothing.

use std::collections::{HashMap, VecDeque};
use std::net::IpAddr;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

/// What a page may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Rights {
    /// Watch.
    Viewer,
    /// Watch, take tools, reset the body, invite others.
    Operator,
}

/// How long a cookie is good for: a day in the laboratory.
pub(crate) const VISIT: Duration = Duration::from_secs(12 * 3600);
/// Tokens that wait to be used, and browsers that are known; beyond, the oldest are forgotten.
const MOST_TOKENS: usize = 64;
const MOST_VISITORS: usize = 256;

/// The keys to the door.
pub(crate) struct Access {
    tokens: VecDeque<(String, Rights)>,
    visitors: HashMap<String, (Rights, Instant)>,
    /// `https`, or `http` without TLS.
    scheme: &'static str,
    /// Origins that were given, in lower case.
    origins: Vec<String>,
}

impl Access {
    pub fn new(scheme: &'static str, origins: &[String]) -> Self {
        let origins = origins.iter().map(|origin| origin.trim_end_matches('/').to_ascii_lowercase()).collect();
        Self { tokens: VecDeque::new(), visitors: HashMap::new(), scheme, origins }
    }

    /// A token that lets one browser in.
    pub fn invite(&mut self, rights: Rights) -> String {
        let token = secret();
        self.tokens.push_back((token.clone(), rights));
        if self.tokens.len() > MOST_TOKENS {
            self.tokens.pop_front();
        }
        token
    }

    /// Takes `token` for the value of a cookie; `None` where there is no such token, or it was used.
    pub fn enter(&mut self, token: &str, now: Instant) -> Option<String> {
        let at = self.tokens.iter().position(|(known, _)| known == token)?;
        let (_, rights) = self.tokens.remove(at)?;
        self.visitors.retain(|_, (_, since)| now.duration_since(*since) < VISIT);
        if self.visitors.len() >= MOST_VISITORS {
            let oldest = self.visitors.iter().min_by_key(|(_, (_, since))| *since).map(|(cookie, _)| cookie.clone());
            if let Some(oldest) = oldest {
                self.visitors.remove(&oldest);
            }
        }
        let cookie = secret();
        self.visitors.insert(cookie.clone(), (rights, now));
        Some(cookie)
    }

    /// What the browser with this cookie may do; `None`: nothing.
    pub fn rights(&self, cookie: &str, now: Instant) -> Option<Rights> {
        let (rights, since) = self.visitors.get(cookie)?;
        (now.duration_since(*since) < VISIT).then_some(*rights)
    }

    /// True where a page of `origin` may open a WebSocket at `host`.
    ///
    /// An origin that was given may. Without one being given only this gateway's own page may, under an address that no
    /// name server can bend: `localhost`, or numbers.
    pub fn admits(&self, origin: &str, host: &str) -> bool {
        let (origin, host) = (origin.to_ascii_lowercase(), host.to_ascii_lowercase());
        let own = format!("{}://{host}", self.scheme) == origin;
        self.origins.contains(&origin) || own && is_number_or_localhost(&host)
    }
}

/// True for `localhost`, `127.0.0.1:80`, `[::1]:80`.
fn is_number_or_localhost(host: &str) -> bool {
    let name = match host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((name, _)) => name,
        None => host.split(':').next().unwrap_or(host),
    };
    name == "localhost" || name.parse::<IpAddr>().is_ok()
}

/// 128 bits that nobody guesses, in hexadecimal.
fn secret() -> String {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).expect("the system has random numbers");
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_opens_once_and_its_cookie_until_the_visit_ends() {
        let mut access = Access::new("http", &[]);
        let now = Instant::now();
        let token = access.invite(Rights::Operator);
        assert_eq!(access.enter("0", now), None);
        let cookie = access.enter(&token, now).unwrap();
        assert_eq!(access.enter(&token, now), None);
        assert_eq!(access.rights(&cookie, now), Some(Rights::Operator));
        assert_eq!(access.rights(&token, now), None);
        assert_eq!(access.rights(&cookie, now + VISIT), None);
        let viewer = access.invite(Rights::Viewer);
        let viewer = access.enter(&viewer, now).unwrap();
        assert_eq!(access.rights(&viewer, now), Some(Rights::Viewer));
    }

    #[test]
    fn tokens_and_visitors_are_bounded_and_the_oldest_are_forgotten() {
        let mut access = Access::new("http", &[]);
        let now = Instant::now();
        let first = access.invite(Rights::Viewer);
        (0..MOST_TOKENS).for_each(|_| drop(access.invite(Rights::Viewer)));
        assert_eq!(access.enter(&first, now), None);
        let token = access.invite(Rights::Viewer);
        let oldest = access.enter(&token, now).unwrap();
        for i in 1..=MOST_VISITORS as u64 {
            let token = access.invite(Rights::Viewer);
            access.enter(&token, now + Duration::from_millis(i)).unwrap();
        }
        assert_eq!((access.visitors.len(), access.rights(&oldest, now)), (MOST_VISITORS, None));
    }

    #[test]
    fn only_the_own_page_and_origins_that_were_given_may_open_a_socket() {
        let access = Access::new("https", &["https://Lab.example/".to_owned()]);
        for (origin, host) in [
            ("https://localhost:8460", "localhost:8460"),
            ("https://192.168.0.5:8460", "192.168.0.5:8460"),
            ("https://[::1]:8460", "[::1]:8460"),
            ("https://lab.example", "127.0.0.1:8460"),
        ] {
            assert!(access.admits(origin, host), "{origin} at {host}");
        }
        for (origin, host) in [
            ("https://evil.example", "localhost:8460"),
            ("https://localhost:8461", "localhost:8460"),
            ("http://localhost:8460", "localhost:8460"),
            // A name that its owner lets point to this machine.
            ("https://evil.example:8460", "evil.example:8460"),
            ("https://localhost.evil.example:8460", "localhost.evil.example:8460"),
            ("null", "localhost:8460"),
            ("", ""),
        ] {
            assert!(!access.admits(origin, host), "{origin} at {host}");
        }
    }
}
