//! What reading costs: memory that is held at once, and time of the processor.

use rustix::time::{ClockId, clock_gettime};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Peak;
thread_local! {
    static HELD: Cell<i64> = const { Cell::new(0) };
    static MOST: Cell<i64> = const { Cell::new(0) };
}

fn count(more: i64) {
    HELD.set(HELD.get() + more);
    MOST.set(MOST.get().max(HELD.get()));
}

// SAFETY: every call is passed on to the system's allocator; counting touches only this thread's cells, which need no
// allocation and no drop.
unsafe impl GlobalAlloc for Peak {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        // SAFETY: passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as i64));
        // SAFETY: passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Peak = Peak;

/// Time of the processor that this thread has taken [s].
fn seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// What `read` gives, of whose memory only what is left at its end is counted: it reserves what it does not touch.
pub fn reserving<T>(read: impl FnOnce() -> T) -> T {
    let most = MOST.get();
    let result = read();
    MOST.set(most.max(HELD.get()));
    result
}

/// What `read` gives. Panics when it held more than a hundred times `bytes` and a megabyte at once, or took the processor
/// for more than a second and 10 µs a byte.
pub fn bounded<T>(bytes: usize, read: impl FnOnce() -> T) -> T {
    let (held, began) = (HELD.get(), seconds());
    MOST.set(held);
    let result = read();
    let (most, took) = (MOST.get() - held, seconds() - began);
    assert!(most < 100 * bytes as i64 + (1 << 20), "{most} bytes held for {bytes} bytes");
    assert!(took < 1.0 + 1e-5 * bytes as f64, "{took} s for {bytes} bytes");
    result
}
