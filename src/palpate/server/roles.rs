//! Who a client is, and what it may do.

use super::ServerError;
use crate::scene::Scene;
use palpate_core::contact::tool::MOST_TOOLS;
use palpate_proto as proto;
use palpate_proto::keys;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Who may connect to a server.
#[derive(Clone, Debug, Default)]
pub enum Trust {
    /// Whoever reaches the endpoints, which are of this machine alone: each may do everything.
    #[default]
    ThisMachine,
    /// Whoever reaches the endpoints, from other machines too: each may do everything.
    Insecure,
    /// Clients that show a certificate of the server's authority, each in its role.
    Certificates {
        /// Folder of the server's certificate, see [`palpate_proto::identity`].
        identity: PathBuf,
        /// Of the names in certificates.
        roles: Roles,
    },
}

/// What a client may do beside watching.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Nothing.
    Viewer,
    /// Hold tools of its own.
    Operator,
    /// Reset the body, set parameters, and record; not touch.
    Instructor,
    /// Hold every tool, reset, set parameters and record.
    Admin,
}

impl Role {
    fn name(self) -> &'static str {
        match self {
            Role::Viewer => "viewer",
            Role::Operator => "operator",
            Role::Instructor => "instructor",
            Role::Admin => "admin",
        }
    }

    /// Requests of control that it may make, of [`keys::ACTIONS`].
    pub(super) fn actions(self) -> &'static [&'static str] {
        match self {
            Role::Viewer => &[],
            Role::Operator => &["attach", "detach"],
            Role::Instructor => &["reset", "record", "set"],
            Role::Admin => &keys::ACTIONS,
        }
    }
}

/// A table of the roles file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    role: Role,
    /// Names of an operator's tools.
    #[serde(default)]
    tools: Vec<String>,
}

/// What stands in a roles file: a table for each name.
#[derive(Clone, Debug)]
pub struct Roles {
    entries: BTreeMap<String, Entry>,
    file: PathBuf,
}

impl Roles {
    /// Reads `file`.
    ///
    /// # Errors
    /// [`ServerError::Roles`]: it cannot be read, or says what makes no sense.
    pub fn read(file: &Path) -> Result<Self, ServerError> {
        let refused = |reason: String| ServerError::Roles { file: file.to_owned(), reason };
        let text = std::fs::read_to_string(file).map_err(|e| refused(e.to_string()))?;
        let entries: BTreeMap<String, Entry> = toml::from_str(&text).map_err(|e| refused(e.to_string()))?;
        for (name, Entry { role, tools }) in &entries {
            let why = if !keys::is_name(name) {
                "a name has letters, digits, '-' and '_'"
            } else if [keys::ANYBODY, keys::NOBODY].contains(&name.as_str()) {
                "this name stands for clients without a certificate or a role"
            } else if (*role == Role::Operator) == tools.is_empty() {
                "an operator has tools, by name, and nobody else: an admin may hold all of them"
            } else {
                continue;
            };
            return Err(refused(format!("{name:?}: {why}")));
        }
        Ok(Self { entries, file: file.to_owned() })
    }

    /// The names, each of a client's certificate.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    /// Who may do what with the tools of `scene`.
    ///
    /// # Errors
    /// [`ServerError::Roles`]: a tool that the scene does not have.
    pub fn clients(&self, scene: &Scene) -> Result<Clients, ServerError> {
        let names: Vec<&str> = tool_names(scene).collect();
        let number = |who: &str, tool: &String| {
            let number = names.iter().position(|name| name == tool).map(|number| number as u32);
            number.ok_or_else(|| ServerError::Roles {
                file: self.file.clone(),
                reason: format!("{who:?}: no tool {tool:?}: the scene has {}", names.join(", ")),
            })
        };
        let client = |(name, entry): (&String, &Entry)| -> Result<(String, Client), ServerError> {
            let tools = match entry.role {
                Role::Admin => (0..names.len() as u32).collect(),
                _ => entry.tools.iter().map(|tool| number(name, tool)).collect::<Result<_, _>>()?,
            };
            Ok((name.clone(), Client { role: entry.role, tools }))
        };
        let by_name = self.entries.iter().map(client).collect::<Result<_, _>>()?;
        Ok(Clients { by_name, have_certificates: true })
    }
}

fn tool_names(scene: &Scene) -> impl Iterator<Item = &str> {
    scene.tool.iter().take(MOST_TOOLS).map(|tool| tool.name.as_str())
}

/// A client that may connect.
#[derive(Clone, Debug)]
pub struct Client {
    pub(super) role: Role,
    /// Numbers of the tools that it may hold.
    pub(super) tools: Vec<u32>,
}

/// Everybody who may connect, by name; nobody by default.
#[derive(Clone, Debug, Default)]
pub struct Clients {
    by_name: BTreeMap<String, Client>,
    /// Whether names are those of certificates. Else there is one, for everybody.
    pub(super) have_certificates: bool,
}

impl Clients {
    /// Everybody may do everything with the tools of `scene`.
    pub(super) fn everybody(scene: &Scene) -> Self {
        let tools = (0..tool_names(scene).count() as u32).collect();
        let by_name = BTreeMap::from([(keys::ANYBODY.to_owned(), Client { role: Role::Admin, tools })]);
        Self { by_name, have_certificates: false }
    }

    /// The client called `name`, which may ask for `action`.
    pub(super) fn who_may(&self, action: &str, name: &str) -> Option<&Client> {
        self.by_name.get(name).filter(|client| client.role.actions().contains(&action))
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (&str, &Client)> {
        self.by_name.iter().map(|(name, client)| (name.as_str(), client))
    }

    /// What clients are told of their roles: each of its own, and everybody of one that is none.
    pub(super) fn describe(&self) -> Vec<proto::Role> {
        let role = |(name, client): (&str, &Client)| proto::Role {
            name: name.into(),
            role: client.role.name().into(),
            actions: client.role.actions().iter().copied().map(String::from).collect(),
            tools: client.tools.clone(),
        };
        let none = proto::Role { name: keys::NOBODY.into(), ..Default::default() };
        self.iter().map(role).chain([none]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Roles, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Roles::read(file.path()).map_err(|e| e.to_string())
    }

    #[test]
    fn what_makes_no_sense_in_a_roles_file_is_named() {
        for (text, word) in [
            ("[\"a/b\"]\nrole = \"viewer\"", "a/b"),
            ("[anybody]\nrole = \"viewer\"", "anybody"),
            ("[anna]\nrole = \"operator\"", "anna"),
            ("[anna]\nrole = \"instructor\"\ntools = [\"left\"]", "anna"),
            ("[anna]\nrole = \"surgeon\"", "surgeon"),
            ("[anna]\nrole = \"viewer\"\ntool = \"left\"", "tool"),
            ("anna = 3", "anna"),
        ] {
            let e = read(text).unwrap_err();
            assert!(e.contains(word), "{text}: {e}");
        }
        assert!(read("[anna]\nrole = \"operator\"\ntools = [\"left\"]\n[wall]\nrole = \"viewer\"").is_ok());
    }
}
