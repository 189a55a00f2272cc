//! What passes between the server's router and its clients: access control of zenoh, made from their roles.

use super::roles::{Client, Clients, Role};
use palpate_proto::keys;
use serde_json::{Value, json};

/// The rules for the session `session`; nothing else passes. So wrenches, frames, status and answers are the server's alone,
/// whoever else sends on their keys, nobody overhears a pose, and a key with a client's name in it is used by that client.
///
/// A rule has to include the whole key of a message, so that one with wildcards passes only where all that it means may.
/// Clients and servers tell each other of what they declare: those messages pass as well.
pub(super) fn access(session: &str, clients: &Clients) -> String {
    let mut access = Access::default();
    // Also for those who have a certificate and no role: they are told so.
    let roles = [keys::all_roles(session)];
    // Servers are found by the liveliness of their session keys.
    let (alive, whoever) = ([keys::session(session)], [keys::session("*")]);
    access.policy(
        "*",
        json!({}),
        &[
            ("ingress", &["query"], &roles),
            ("egress", &["declare_queryable"], &roles),
            ("egress", &["reply"], &[keys::role(session, keys::NOBODY)]),
            ("egress", &["liveliness_token"], &alive),
            ("ingress", &["declare_liveliness_subscriber", "liveliness_query"], &whoever),
        ],
    );
    for (name, client) in clients.iter() {
        let who = if clients.have_certificates { json!({ "cert_common_names": [name] }) } else { json!({}) };
        access.client(session, name, who, client);
    }
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": access.rules,
        "subjects": access.subjects,
        "policies": access.policies,
    })
    .to_string()
}

#[derive(Default)]
struct Access {
    rules: Vec<Value>,
    subjects: Vec<Value>,
    policies: Vec<Value>,
}

/// Way, messages and keys that may pass together.
type Rule<'a> = (&'a str, &'a [&'a str], &'a [String]);

impl Access {
    /// Lets `rules` pass for the subject `id`, who is `who`.
    fn policy(&mut self, id: &str, mut who: Value, rules: &[Rule]) {
        let first = self.rules.len();
        for (flow, messages, keys) in rules.iter().filter(|(_, _, keys)| !keys.is_empty()) {
            let id = self.rules.len().to_string();
            self.rules.push(json!({
                "id": id, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys,
            }));
        }
        let ids: Vec<String> = (first..self.rules.len()).map(|id| id.to_string()).collect();
        who["id"] = id.into();
        self.subjects.push(who);
        self.policies.push(json!({ "rules": ids, "subjects": [id] }));
    }

    fn client(&mut self, session: &str, name: &str, who: Value, client: &Client) {
        let tools: Vec<String> = match client.role {
            Role::Admin => vec!["*".into()],
            _ => client.tools.iter().map(u32::to_string).collect(),
        };
        let of_tools = |key: fn(&str, &str) -> String| tools.iter().map(move |tool| key(session, tool));
        let presence: Vec<String> = of_tools(|session, tool| keys::presence(session, tool, "*")).collect();
        let mut sent: Vec<String> = of_tools(|session, tool| keys::tool_pose(session, tool)).collect();
        let mut heard: Vec<String> = of_tools(|session, tool| keys::tool_wrench(session, tool)).collect();
        if !tools.is_empty() {
            sent.push(keys::echo_request(session));
            heard.push(keys::echo_reply(session));
        }
        heard.extend([keys::status(session), keys::all_surface_frames(session)]);
        let about = [
            keys::session_of_any_version(session),
            keys::surface_topology(session),
            keys::surface_key(session),
            keys::surface_pictures(session),
        ];
        let asked: Vec<String> = client
            .role
            .actions()
            .iter()
            .map(|action| keys::control(session, action, name))
            .chain(about.clone())
            .collect();
        let answered = [&asked[..], &[keys::role(session, name)]].concat();
        // What the server declares is for all clients the same.
        let offered = [&about[..], &[keys::all_control(session)]].concat();
        let wanted = [keys::all_tool_poses(session), keys::echo_request(session)];
        let all_presence = [keys::all_presence(session)];
        self.policy(
            name,
            who,
            &[
                ("ingress", &["put"], &sent),
                ("ingress", &["query"], &asked),
                ("ingress", &["declare_subscriber"], &heard),
                ("ingress", &["liveliness_token"], &presence),
                ("egress", &["put"], &heard),
                ("egress", &["reply"], &answered),
                ("egress", &["declare_queryable"], &offered),
                ("egress", &["declare_subscriber"], &wanted),
                ("egress", &["declare_liveliness_subscriber", "liveliness_query"], &all_presence),
            ],
        );
    }
}
