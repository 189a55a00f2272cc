//! Queries: each is answered in a task of its own and within a deadline, however slow the disk is or whoever asked reads.
//!
//! What receives a query is a thread of zenoh that receives poses, too, so it only hands on. Few are answered at once, some
//! wait, and more are told that the server is busy.

use super::health::{Health, Weight};
use super::{ServerError, network};
use std::sync::{Arc, mpsc};
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::sync::Semaphore;
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::query::Query;

/// How long an answer may take: less than the two seconds for which clients wait.
const DEADLINE: Duration = Duration::from_millis(1800);
/// Queries of a kind that are answered at once, each on a thread that waits for the asker to read. More cost memory, 2 MB a
/// thread, which is locked; with fewer, one slow reader keeps the others waiting.
const PLACES: usize = 4;
/// Queries of a kind that wait for a place: a hundred viewers that come at once, with some room.
const WAITING: usize = 256;
/// Queries that wait to be turned away.
const TURNED_AWAY: usize = 4096;

/// An answer: payloads, each with its key.
pub(super) type Answer = Vec<(String, ZBytes)>;

/// Where queries are taken.
pub(super) struct Desk {
    turned_away: mpsc::SyncSender<Query>,
    exit: Exit,
}

/// Through which answers leave, message by message; whoever comes first is the first to pass.
///
/// A message for an asker who does not read waits until that is cut off. Of several at once, each would wait for as long, one after the
/// other, and with the last of them the only thread of zenoh that sends, of the hands' wrenches, too.
#[derive(Clone)]
struct Exit {
    runtime: Handle,
    free: Arc<Semaphore>,
}

impl Exit {
    /// Does what hands a message to zenoh, on a thread that may wait.
    fn pass<T>(&self, send: impl FnOnce() -> T) -> T {
        let _alone = self.runtime.block_on(self.free.acquire());
        send()
    }
}

impl Desk {
    /// In a tokio runtime. Starts the thread that tells askers that the server is busy: that, too, waits until they read.
    pub(super) fn open(health: &Arc<Health>) -> std::io::Result<Self> {
        let (turned_away, turn_away) = mpsc::sync_channel::<Query>(TURNED_AWAY);
        let exit = Exit { runtime: Handle::current(), free: Arc::new(Semaphore::new(1)) };
        let out = exit.clone();
        let watch = health.watch("the thread that turns queries away", Weight::Degrades);
        std::thread::Builder::new().name("turn away".into()).spawn(move || {
            let _watch = watch;
            for query in turn_away {
                out.pass(move || {
                    let _ = query.reply_err(BUSY).wait();
                });
            }
        })?;
        Ok(Self { turned_away, exit })
    }

    /// Offers `key` on `session` until this closes; `answer` gets the key and the payload of a query.
    pub(super) async fn offer<F>(
        &self,
        session: &zenoh::Session,
        key: String,
        answer: impl Fn(String, Vec<u8>) -> F + Send + Sync + 'static,
    ) -> Result<(), ServerError>
    where
        F: Future<Output = Answer> + Send + 'static,
    {
        let (places, waiting) = (Arc::new(Semaphore::new(PLACES)), Arc::new(Semaphore::new(WAITING)));
        let (exit, turned_away, answer) = (self.exit.clone(), self.turned_away.clone(), Arc::new(answer));
        let take = move |query: Query| {
            let Ok(wait) = waiting.clone().try_acquire_owned() else {
                // Where even these are too many, the asker gets no answer.
                return drop(turned_away.try_send(query));
            };
            let (places, answer, turned_away) = (places.clone(), answer.clone(), turned_away.clone());
            let exit = exit.clone();
            exit.runtime.clone().spawn(async move {
                let payload = query.payload().map(|payload| payload.to_bytes().into_owned()).unwrap_or_default();
                let key = query.key_expr().to_string();
                let answered = async move {
                    let place = places.acquire_owned().await;
                    (place, answer(key, payload).await)
                };
                match tokio::time::timeout(DEADLINE, answered).await {
                    Ok((place, answer)) => {
                        let reply = move || {
                            reply(&exit, query, answer);
                            drop((place, wait));
                        };
                        drop(tokio::task::spawn_blocking(reply));
                    }
                    Err(_) => drop(turned_away.try_send(query)),
                }
            });
        };
        session.declare_queryable(key).callback(take).background().await.map_err(network)
    }
}

/// What an asker is told that comes when too many do.
const BUSY: &str = "busy: ask again later";

fn reply(exit: &Exit, query: Query, answer: Answer) {
    for (key, payload) in answer {
        if let Err(e) = exit.pass(|| query.reply(key, payload).wait()) {
            tracing::debug!("a query went unanswered: {e}");
            break;
        }
    }
    // That is a message, too: nothing more comes.
    exit.pass(move || drop(query));
}
