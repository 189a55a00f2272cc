//! A network of machines that are none: network namespaces, and roads between them with delay, loss and closures.
//!
//! Every site is a namespace with one interface, a TUN device, whose packets this process carries: the kernel's own means for
//! delay and loss (`netem`) are not in every kernel. What runs at a site knows nothing of that.
#![allow(dead_code, reason = "each test uses a part")]

use super::random::Random;
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::process::ExitStatusExt;
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, mpsc};
use std::time::{Duration, Instant};

/// Set where this process is alone in namespaces of its own.
const APART: &str = "PALPATE_TEST_APART";

/// Where a test runs that wants a network of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Apart {
    /// In one: [`Roads::build`] works.
    Here,
    /// It has been run in one, in another process, and has passed.
    Ran,
    /// The system grants none.
    Refused,
}

/// Runs the test `name` of this program, with its modules, once more in a process with a network of its own; called there, it
/// says so. Fails where the test does.
pub fn apart(name: &str) -> Apart {
    if std::env::var_os(APART).is_some() {
        return Apart::Here;
    }
    let unshare = |with: &[&str]| {
        let mut unshare = Command::new("unshare");
        unshare.args(with);
        unshare
    };
    // As root the server keeps its real-time class; others get a user namespace.
    let ways: [&[&str]; 2] = [&["-n"], &["-rn"]];
    let tries = |way: &&&[&str]| {
        let check = "ip link set lo up && ip tuntap add dev try mode tun";
        unshare(way).args(["sh", "-c", check]).output().is_ok_and(|outcome| outcome.status.success())
    };
    let Some(way) = ways.iter().find(tries) else {
        println!("skipped, all or in part: {name} needs network namespaces and TUN devices");
        return Apart::Refused;
    };
    let mut again = unshare(way);
    again.arg(std::env::current_exe().unwrap()).args([name, "--exact", "--nocapture"]).env(APART, "1");
    let status = again.status().unwrap();
    assert!(status.success(), "{name} in a network of its own: {status}, signal {:?}", status.signal());
    Apart::Ran
}

/// What a road does to each packet, one way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Road {
    /// On the way.
    pub delay: Duration,
    /// Part of the packets that are lost; 1: the road is closed.
    pub loss: f64,
}

/// A machine that is none.
pub struct Site {
    number: u8,
    namespace: File,
}

impl Site {
    /// Its address.
    pub fn address(&self) -> String {
        format!("10.77.0.{}", self.number)
    }

    /// An endpoint of zenoh there.
    pub fn endpoint(&self, port: u16) -> String {
        format!("tcp/{}:{port}", self.address())
    }

    /// `program`, to be run there.
    pub fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("nsenter");
        let namespace = format!("--net=/proc/{}/fd/{}", std::process::id(), self.namespace.as_raw_fd());
        command.arg(namespace).arg(program);
        command
    }
}

/// Sites that reach each other. It lasts until the process ends.
pub struct Roads {
    /// The namespace of this process comes first.
    pub sites: Vec<Site>,
    between: Arc<Mutex<Vec<Vec<Road>>>>,
    /// Bytes carried from each to each.
    carried: Arc<Vec<Vec<AtomicU64>>>,
}

impl Roads {
    /// Between `count` sites, without delay or loss. To be called once [`apart`], and once in a process.
    pub fn build(count: u8) -> Self {
        let count_of = usize::from(count);
        let opened: Vec<(Site, File)> = (1..=count).map(open).collect();
        let (sites, devices): (Vec<_>, Vec<_>) = opened.into_iter().unzip();
        let between = Arc::new(Mutex::new(vec![vec![Road::default(); count_of]; count_of]));
        let carried: Arc<Vec<Vec<AtomicU64>>> =
            Arc::new((0..count).map(|_| (0..count).map(|_| AtomicU64::new(0)).collect()).collect());
        for (from, device) in devices.iter().enumerate() {
            let lanes: Vec<_> = devices.iter().map(|device| lane(device.try_clone().unwrap())).collect();
            let (mut device, between, carried) = (device.try_clone().unwrap(), between.clone(), carried.clone());
            let mut random = Random(from as u64);
            std::thread::spawn(move || {
                let mut packet = [0; 2048];
                loop {
                    let length = device.read(&mut packet).unwrap();
                    let packet = &packet[..length];
                    // IPv4 alone; the last byte of where it goes is the site.
                    let to = packet.get(19).map_or(0, |last| usize::from(*last)).wrapping_sub(1);
                    if packet[0] >> 4 != 4 || to >= lanes.len() {
                        continue;
                    }
                    let road = between.lock().unwrap()[from][to];
                    if random.between(0.0, 1.0) >= road.loss {
                        carried[from][to].fetch_add(length as u64, Relaxed);
                        lanes[to].send((Instant::now() + road.delay, packet.to_vec())).unwrap();
                    }
                }
            });
        }
        Self { sites, between, carried }
    }

    /// From now on both ways between the sites `a` and `b` are as `road`.
    pub fn set(&self, a: usize, b: usize, road: Road) {
        let mut between = self.between.lock().unwrap();
        (between[a][b], between[b][a]) = (road, road);
    }

    /// Bytes carried so far from site `from` to all others.
    pub fn carried(&self, from: usize) -> u64 {
        self.carried[from].iter().map(|bytes| bytes.load(Relaxed)).sum()
    }
}

/// Writes packets to `device` when they are due.
fn lane(mut device: File) -> mpsc::Sender<(Instant, Vec<u8>)> {
    let (send, arrive) = mpsc::channel::<(Instant, Vec<u8>)>();
    std::thread::spawn(move || {
        for (due, packet) in arrive {
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            // A packet that the kernel does not take is one that is lost.
            let _ = device.write(&packet);
        }
    });
    send
}

/// Site `number`, from 1, with its device; the first is the namespace of this process.
fn open(number: u8) -> (Site, File) {
    // What a thread does to its namespace, the others do not see, and what it starts is in it.
    let opened = std::thread::spawn(move || {
        if number > 1 {
            // SAFETY: it takes no pointers.
            let outcome = unsafe { libc::unshare(libc::CLONE_NEWNET) };
            assert_eq!(outcome, 0, "{}", std::io::Error::last_os_error());
        }
        let device = File::options().read(true).write(true).open("/dev/net/tun").unwrap();
        // SAFETY: zeros are an `ifreq`.
        let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
        for (to, from) in request.ifr_name.iter_mut().zip(b"road") {
            *to = *from as libc::c_char;
        }
        request.ifr_ifru.ifru_flags = (libc::IFF_TUN | libc::IFF_NO_PI) as i16;
        // SAFETY: the request is an `ifreq` that lives until the call returns.
        let outcome = unsafe { libc::ioctl(device.as_raw_fd(), libc::TUNSETIFF as _, &raw mut request) };
        assert_eq!(outcome, 0, "{}", std::io::Error::last_os_error());
        let up = format!(
            "ip link set lo up && ip address add 10.77.0.{number}/24 dev road && ip link set road txqueuelen 5000 up"
        );
        assert!(Command::new("sh").args(["-c", &up]).status().unwrap().success());
        (Site { number, namespace: File::open("/proc/thread-self/ns/net").unwrap() }, device)
    });
    opened.join().unwrap()
}
