//! A zenoh session that keeps to no contract.
#![allow(dead_code, reason = "each test uses a part")]

use zenoh::Wait as _;

/// Somebody without the sdk's care.
pub fn stranger(endpoint: &str) -> zenoh::Session {
    stranger_with(endpoint, vec![])
}

/// The same with more settings of zenoh.
pub fn stranger_with(endpoint: &str, settings: Vec<(String, String)>) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".into()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    for (key, value) in settings {
        config.insert_json5(&key, &value).unwrap();
    }
    zenoh::open(config).wait().unwrap()
}
