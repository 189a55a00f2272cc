//! A client without a display or a device: finds the session of a running `palpate serve`, takes a tool, presses it into the
//! highest place of the body and prints the force: `cargo run -p palpate-sdk --example press`.

use palpate_sdk::{Attachment, Connection, Endpoints, PoseSample, SdkError};
use std::time::Duration;

/// How far the tool's reference point goes above and below the place [m].
const TRAVEL: f64 = 0.02;
/// Poses, one a millisecond.
const POSES: u32 = 1000;

/// Presses and gives the force along z [N], ten times on the way; prints it, too.
pub fn press(endpoints: &Endpoints) -> Result<Vec<f64>, SdkError> {
    let connection = Connection::open(endpoints)?;
    let session = connection.session()?;
    println!("session {}: {} tools", session.name, session.tools.len());
    let surface = connection.surface_topology()?;
    let highest = surface.rest_positions.iter().max_by(|a, b| a[2].total_cmp(&b[2])).copied().unwrap_or_default();
    let place = highest.map(f64::from);

    // Any free tool, held rigidly; it is let go when it is dropped.
    let mut tool = connection.attach(&Attachment { client: "press".into(), ..Attachment::default() })?;
    let mut forces = Vec::new();
    for i in 0..POSES {
        let down = f64::from(i) / f64::from(POSES);
        tool.send_pose(PoseSample {
            position: [place[0], place[1], place[2] + TRAVEL * (1.0 - 2.0 * down)],
            orientation: [0.0, 0.0, 0.0, 1.0],
            linear_velocity: None,
            buttons: 0,
            opening: 0.0,
        })?;
        std::thread::sleep(Duration::from_millis(1));
        if (i + 1) % (POSES / 10) == 0 {
            // What may be rendered now: it fades where the server has fallen silent.
            let force = tool.safe_force(tool.now_ns());
            println!("{:5.1} mm: {:.3} N", 1e3 * TRAVEL * (1.0 - 2.0 * down), force[2]);
            forces.push(force[2]);
        }
    }
    tool.detach()?;
    Ok(forces)
}

fn main() -> Result<(), SdkError> {
    press(&Endpoints::default()).map(drop)
}
