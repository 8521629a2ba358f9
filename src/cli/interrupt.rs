//! Ctrl-C: the first one ends the render and keeps what is there, the second one the program.

use std::{
    process,
    sync::atomic::{AtomicBool, Ordering},
};

use wavecast::film;

/// As shells have it: 128 + SIGINT.
pub const EXIT_CODE: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);
static WORTH_KEEPING: AtomicBool = AtomicBool::new(false);

/// Listens for Ctrl-C and requests to terminate.
pub fn install() {
    let heard = || {
        let first = !ASKED.swap(true, Ordering::Relaxed);
        if first && WORTH_KEEPING.load(Ordering::Relaxed) {
            eprintln!("interrupted: writing what is there; once more aborts");
        } else {
            film::discard_unfinished();
            eprintln!("interrupted: nothing more is written");
            process::exit(EXIT_CODE.into());
        }
    };
    // Without a listener the system's own way of ending the program remains.
    let _ = ctrlc::set_handler(heard);
}

/// From here on an interrupted render still writes its files.
pub fn keep_from_now_on() {
    WORTH_KEEPING.store(true, Ordering::Relaxed);
}

/// True once Ctrl-C was pressed.
pub fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}
