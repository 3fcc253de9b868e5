//! What a thread of the tests has allocated, and the most that it had at a time.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
};

thread_local! {
    /// Bytes that it holds, and the most that it held.
    static HELD: Cell<[i64; 2]> = const { Cell::new([0; 2]) };
}

#[global_allocator]
static COUNTED: Counted = Counted;

struct Counted;

fn add(bytes: i64) {
    // A thread that ends has no such place any more.
    let _ = HELD.try_with(|held| {
        let [now, most] = held.get();
        held.set([now + bytes, most.max(now + bytes)]);
    });
}

// SAFETY: the system's allocator does it all.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as i64);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size() as i64);
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        add(size as i64 - layout.size() as i64);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(at, layout, size) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        add(-(layout.size() as i64));
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(at, layout) }
    }
}

/// What this thread holds, bytes. [`most_since`] begins here.
pub fn held() -> i64 {
    HELD.with(|held| {
        let [now, _] = held.get();
        held.set([now, now]);
        now
    })
}

/// The most that this thread held since, beyond what it held then.
pub fn most_since(held: i64) -> u64 {
    HELD.with(|all| (all.get()[1] - held).max(0) as u64)
}
