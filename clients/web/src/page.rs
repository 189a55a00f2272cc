//! One WebSocket: what a page sends, and what it is sent.
//!
//! Every queue is bounded. Of surface frames, states and wrenches a page gets the newest when it has taken the last: a
//! slow page misses some, and the gateway keeps none for it. Of poses the newest goes on. Answers and notices wait in a
//! short queue; a page that does not take them is closed, and so is one that is silent or sends what is no message.

use std::collections::VecDeque;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use futures_util::{SinkExt, StreamExt, stream::SplitSink, stream::SplitStream};
use palpate_sdk::proto::{Attached, Detach};
use palpate_sdk::{Attachment, ControlReply, ControlRequest, control_request::Request};
use tokio::sync::{mpsc, watch};
use tokio::time::{MissedTickBehavior, interval, timeout};

use crate::Rights;
use crate::gateway::Shared;
use crate::hands::{Hands, Taken};
use crate::message::{self, FromPage, Notice, Wish};
use crate::upstream::{Link, World, blocking};

/// Between two looks at wrenches and poses that wait.
const BEAT: Duration = Duration::from_millis(8);
/// The browser answers each ping by itself; a page without a sign of life is gone.
const PING: Duration = Duration::from_secs(5);
const SILENCE: Duration = Duration::from_secs(15);
/// How long a message may take to leave: the page does not read.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long a page that is closed has to say so.
const GOODBYE: Duration = Duration::from_secs(1);
/// Frames that a page has not said to have decoded. The system's own buffers hold megabytes: only the page knows how far
/// behind it is.
const MOST_UNDER_WAY: usize = 4;
/// Answers and notices that wait for a page, and requests of it that wait to be carried out.
const OUTBOX: usize = 32;
const REQUESTS: usize = 4;
/// Messages that a page may send in a second; two hands at 120 Hz send 240.
const MOST_MESSAGES: u32 = 1000;
/// Messages that are none before a page is closed.
const MOST_MALFORMED: u32 = 16;
/// Tools that a page may hold.
const MOST_TOOLS: usize = 4;
/// Poses a second that a page may say it sends [Hz].
const RATE: std::ops::RangeInclusive<f64> = 10.0..=250.0;
/// Between two notices that poses are refused.
const REFUSAL: Duration = Duration::from_secs(1);

/// Why a page is closed.
type Closed = (u16, &'static str);

struct Page {
    shared: Arc<Shared>,
    rights: Rights,
    hands: Mutex<Hands>,
    outbox: mpsc::Sender<Message>,
    /// Sequence of the newest frame that the page has decoded.
    seen: watch::Sender<u64>,
}

/// Serves a page until it ends.
pub(crate) async fn serve(socket: WebSocket, rights: Rights, shared: Arc<Shared>) {
    let (sink, mut stream) = socket.split();
    let (outbox, out) = mpsc::channel(OUTBOX);
    let (requests, todo) = mpsc::channel(REQUESTS);
    let page = Page { shared, rights, hands: Mutex::default(), outbox, seen: watch::Sender::new(0) };
    let _ = page.tell(&Notice::Welcome { rights });
    let mut sink = Outlet(sink);
    let (code, reason) = tokio::select! {
        closed = page.read(&mut stream, requests) => closed,
        closed = page.write(&mut sink, out) => closed,
        closed = page.control(todo) => closed,
    };
    tracing::debug!("a page ends: {reason}");
    let _ = sink.send(Message::Close(Some(CloseFrame { code, reason: reason.into() }))).await;
    // Tools are given back over the network.
    let hands = std::mem::take(&mut *page.hands());
    let _ = tokio::task::spawn_blocking(move || drop(hands)).await;
    // What is still on the way here is dropped: the end of the connection would else overtake the reason.
    let _ = timeout(GOODBYE, async { while let Some(Ok(_)) = stream.next().await {} }).await;
}

/// The way to a page.
struct Outlet(SplitSink<WebSocket, Message>);

impl Outlet {
    async fn send(&mut self, message: Message) -> Result<(), Closed> {
        match timeout(PATIENCE, self.0.send(message)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) => Err((close_code::AWAY, "the connection broke")),
            Err(_) => Err((close_code::AWAY, "the page takes nothing any more")),
        }
    }

    async fn send_all(&mut self, messages: &[Bytes]) -> Result<(), Closed> {
        for bytes in messages {
            self.send(Message::Binary(bytes.clone())).await?;
        }
        Ok(())
    }
}

impl Page {
    fn hands(&self) -> MutexGuard<'_, Hands> {
        self.hands.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a notice into the outbox.
    fn tell(&self, notice: &Notice) -> Result<(), Closed> {
        let text = serde_json::to_string(notice).expect("a notice is JSON");
        self.post(Message::Text(text.into()))
    }

    fn post(&self, message: Message) -> Result<(), Closed> {
        self.outbox.try_send(message).map_err(|_| (close_code::POLICY, "the page does not take its answers"))
    }

    fn world(&self) -> Option<Arc<World>> {
        match &*self.shared.upstream.link().borrow() {
            Link::Open(world) => Some(world.clone()),
            Link::Waiting(_) => None,
        }
    }

    /// Takes what the page sends.
    async fn read(&self, stream: &mut SplitStream<WebSocket>, requests: mpsc::Sender<ControlRequest>) -> Closed {
        let (mut malformed, mut messages, mut second) = (0, 0, Instant::now());
        let mut refused: Option<Instant> = None;
        loop {
            let message = match timeout(SILENCE, stream.next()).await {
                Err(_) => return (close_code::AWAY, "the page is silent"),
                Ok(None | Some(Ok(Message::Close(_)))) => return (close_code::NORMAL, "the page went"),
                // What is no WebSocket frame, or longer than a message may be.
                Ok(Some(Err(_))) => return (close_code::PROTOCOL, "the connection broke"),
                Ok(Some(Ok(message))) => message,
            };
            if second.elapsed() > Duration::from_secs(1) {
                (messages, second) = (0, Instant::now());
            }
            messages += 1;
            if messages > MOST_MESSAGES {
                return (close_code::POLICY, "too many messages");
            }
            let outcome = match message {
                Message::Binary(bytes) => match FromPage::decode(&bytes) {
                    Some(FromPage::Pose { tool, pose }) => {
                        let taken = self.hands().pose(tool, pose, Instant::now());
                        self.count(taken);
                        let now = Instant::now();
                        let silent = refused.is_some_and(|last| now.duration_since(last) < REFUSAL);
                        if taken == Taken::NotHeld && !silent {
                            refused = Some(now);
                            let fault = match self.rights {
                                Rights::Viewer => "this page may watch, not touch".to_owned(),
                                Rights::Operator => format!("this page does not hold tool {tool}"),
                            };
                            self.tell(&Notice::Refused { fault })
                        } else {
                            Ok(())
                        }
                    }
                    Some(FromPage::Control(request)) => match requests.try_send(request) {
                        Ok(()) => Ok(()),
                        Err(_) => Err((close_code::POLICY, "too many requests at once")),
                    },
                    Some(FromPage::Seen(sequence)) => {
                        self.seen.send_replace(sequence);
                        Ok(())
                    }
                    None => self.malformed(&mut malformed),
                },
                Message::Text(text) => match serde_json::from_str(&text) {
                    Ok(wish) => self.grant(wish),
                    Err(_) => self.malformed(&mut malformed),
                },
                _ => Ok(()),
            };
            if let Err(closed) = outcome {
                return closed;
            }
        }
    }

    fn malformed(&self, count: &mut u32) -> Result<(), Closed> {
        *count += 1;
        self.shared.counters.malformed.fetch_add(1, Relaxed);
        if *count > MOST_MALFORMED {
            return Err((close_code::POLICY, "what the page sends is no message"));
        }
        self.tell(&Notice::Refused { fault: "that is no message".to_owned() })
    }

    fn count(&self, taken: Taken) {
        let counters = &self.shared.counters;
        match taken {
            Taken::Sent | Taken::Waits => counters.poses.fetch_add(1, Relaxed),
            Taken::Superseded => counters.poses_superseded.fetch_add(1, Relaxed),
            Taken::NotHeld | Taken::Stale => counters.poses_refused.fetch_add(1, Relaxed),
        };
    }

    fn grant(&self, Wish::Invite { rights }: Wish) -> Result<(), Closed> {
        if self.rights != Rights::Operator {
            return self.tell(&Notice::Refused { fault: "this page may watch, not invite".to_owned() });
        }
        let path = self.shared.invite(rights);
        self.tell(&Notice::Invitation { path, rights })
    }

    /// Sends what there is to see and to feel.
    async fn write(&self, sink: &mut Outlet, mut out: mpsc::Receiver<Message>) -> Closed {
        let mut link = self.shared.upstream.link();
        loop {
            let now = link.borrow_and_update().clone();
            let outcome = match now {
                Link::Waiting(fault) => {
                    let notice = Notice::Link { fault: Some(fault) };
                    match self.tell(&notice) {
                        Ok(()) => self.wait(sink, &mut out, &mut link).await,
                        Err(closed) => Err(closed),
                    }
                }
                Link::Open(world) => match self.tell(&Notice::Link { fault: None }) {
                    Ok(()) => self.show(&world, sink, &mut out, &mut link).await,
                    Err(closed) => Err(closed),
                },
            };
            if let Err(closed) = outcome {
                return closed;
            }
        }
    }

    /// Sends notices until the link changes.
    async fn wait(
        &self,
        sink: &mut Outlet,
        out: &mut mpsc::Receiver<Message>,
        link: &mut watch::Receiver<Link>,
    ) -> Result<(), Closed> {
        self.beat(None, false, sink).await?;
        let mut pings = interval(PING);
        loop {
            tokio::select! {
                Some(message) = out.recv() => sink.send(message).await?,
                _ = pings.tick() => sink.send(Message::Ping(Bytes::new())).await?,
                changed = link.changed() => return changed.map_err(|_| (close_code::AWAY, "the gateway ends")),
            }
        }
    }

    /// Sends all of `world` until the link changes.
    async fn show(
        &self,
        world: &Arc<World>,
        sink: &mut Outlet,
        out: &mut mpsc::Receiver<Message>,
        link: &mut watch::Receiver<Link>,
    ) -> Result<(), Closed> {
        let (mut session, mut status, mut frames) = (world.session.clone(), world.status.clone(), world.frames.clone());
        let description = session.borrow_and_update().clone();
        sink.send(Message::Binary(description)).await?;
        sink.send_all(&world.topology).await?;
        frames.mark_changed();
        let (mut key, mut last) = (None, None);
        // Sequences of frames that the page has not decoded.
        let mut under_way: VecDeque<u64> = VecDeque::new();
        let mut seen = self.seen.subscribe();
        let (mut beat, mut pings) = (interval(BEAT), interval(PING));
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                biased;
                changed = link.changed() => return changed.map_err(|_| (close_code::AWAY, "the gateway ends")),
                Some(message) = out.recv() => sink.send(message).await?,
                _ = pings.tick() => sink.send(Message::Ping(Bytes::new())).await?,
                Ok(()) = seen.changed() => {
                    let seen = *seen.borrow_and_update();
                    under_way.retain(|sequence| *sequence > seen);
                }
                _ = beat.tick() => self.beat(Some(world), under_way.len() < MOST_UNDER_WAY, sink).await?,
                Ok(()) = session.changed() => {
                    let bytes = session.borrow_and_update().clone();
                    sink.send(Message::Binary(bytes)).await?;
                }
                Ok(()) = status.changed() => {
                    let bytes = status.borrow_and_update().clone();
                    sink.send(Message::Binary(bytes)).await?;
                }
                Ok(()) = frames.changed(), if under_way.len() < MOST_UNDER_WAY => {
                    let newest = frames.borrow_and_update().clone();
                    let (Some(key_frame), Some(frame)) = (newest.key, newest.frame) else { continue };
                    if key != Some(frame.key) && frame.key != frame.sequence {
                        sink.send_all(&key_frame.parts).await?;
                    }
                    key = Some(frame.key);
                    sink.send_all(&frame.parts).await?;
                    let missed = last.map_or(0, |last: u64| frame.sequence.saturating_sub(last + 1));
                    last = Some(frame.sequence);
                    under_way.push_back(frame.sequence);
                    self.shared.counters.frames.fetch_add(1, Relaxed);
                    self.shared.counters.frames_missed.fetch_add(missed, Relaxed);
                }
            }
        }
    }

    /// Poses on; wrenches to the page, if it `takes` them.
    async fn beat(&self, world: Option<&Arc<World>>, takes: bool, sink: &mut Outlet) -> Result<(), Closed> {
        if self.hands().is_empty() {
            return Ok(());
        }
        let (wrenches, lost) = self.hands().beat(world, Instant::now());
        for wrench in wrenches.iter().filter(|_| takes) {
            sink.send(Message::Binary(message::to_page(message::TOOL_WRENCH, wrench))).await?;
        }
        for (tool, fault) in lost {
            self.tell(&Notice::Lost { tool, fault: fault.to_owned() })?;
        }
        Ok(())
    }

    /// Carries out requests, one after another.
    async fn control(&self, mut requests: mpsc::Receiver<ControlRequest>) -> Closed {
        while let Some(request) = requests.recv().await {
            let reply =
                self.carry_out(request).await.unwrap_or_else(|error| ControlReply { error, ..Default::default() });
            let answer = Message::Binary(message::to_page(message::CONTROL_REPLY, &reply));
            if let Err(closed) = self.post(answer) {
                return closed;
            }
        }
        // The reader has ended.
        std::future::pending().await
    }

    async fn carry_out(&self, request: ControlRequest) -> Result<ControlReply, String> {
        if self.rights != Rights::Operator {
            return Err("this page may watch, not touch".to_owned());
        }
        let world = self.world().ok_or("the server is not there")?;
        match request.request {
            Some(Request::Attach(attach)) => {
                if self.hands().count() >= MOST_TOOLS {
                    return Err(format!("this page holds {MOST_TOOLS} tools, which is the most"));
                }
                let name: String = attach.client.chars().filter(|c| !c.is_control()).take(40).collect();
                let attachment = Attachment {
                    client: format!("page {name}"),
                    tool: attach.tool,
                    rate_hz: attach.rate_hz.clamp(*RATE.start(), *RATE.end()),
                    ..Attachment::default()
                };
                let connection = world.connection.clone();
                let tool = blocking(move || connection.attach(&attachment)).await?;
                // The page's connection is its own, and the secret stays here.
                let attached = Attached { tool: tool.id(), epoch: tool.epoch(), secret: 0 };
                self.hands().hold(tool, world);
                Ok(ControlReply { attached: Some(attached), ..Default::default() })
            }
            Some(Request::Detach(Detach { tool, epoch, .. })) => {
                let held = self.hands().release(tool, epoch);
                let held = held.ok_or_else(|| format!("this page does not hold tool {tool}"))?;
                blocking(move || held.detach()).await?;
                Ok(ControlReply::default())
            }
            Some(request @ Request::Reset(_)) => {
                let connection = world.connection.clone();
                blocking(move || connection.control(request)).await
            }
            Some(Request::StartRecording(_) | Request::StopRecording(_)) => {
                Err("a page does not record: palpate record does".to_owned())
            }
            Some(Request::Set(_)) => Err("a page sets no parameters: palpate set does".to_owned()),
            None => Err("that is no request".to_owned()),
        }
    }
}
