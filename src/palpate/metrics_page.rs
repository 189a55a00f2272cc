//! The page on which Prometheus finds what the server counts.

use anyhow::Context;
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder};
use palpate::server::TIMES;
use std::net::SocketAddr;

/// Upper ends of the buckets of times [s], about a factor of two apart around a tick of 1 ms.
const BUCKETS: [f64; 14] = [1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 3e-4, 5e-4, 7e-4, 1e-3, 1.5e-3, 2e-3, 5e-3, 2e-2, 1e-1];

/// Serves it at `address` as long as the runtime lives in which this is called.
///
/// # Errors
/// The address is taken, or none of this machine.
pub fn serve(address: SocketAddr) -> anyhow::Result<()> {
    let mut page = PrometheusBuilder::new().with_http_listener(address);
    for name in TIMES {
        page = page.set_buckets_for_metric(Matcher::Full(name.into()), &BUCKETS)?;
    }
    page.install()
        .with_context(|| format!("--metrics {address}: give an address of this machine, and a port that is free"))
}
