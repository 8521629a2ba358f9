//! Progress bars.

use std::{fmt::Display, io::IsTerminal, time::Duration};

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use wavecast::render::{Observer, Progress};

use super::interrupt;

/// Parts of the bar; finer than any terminal shows.
const PARTS: u64 = 10_000;

/// A bar of so many parts, if stderr is a terminal and not `quiet`.
fn bar(quiet: bool, parts: u64, template: &str) -> Option<ProgressBar> {
    (!quiet && std::io::stderr().is_terminal()).then(|| {
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::with_draw_target(Some(parts), ProgressDrawTarget::stderr()).with_style(style)
    })
}

/// Shows the way of a render on a terminal, and passes Ctrl-C on to it.
pub struct Watcher {
    bar: Option<ProgressBar>,
}

impl Watcher {
    /// With a bar if stderr is a terminal and not `quiet`.
    pub fn new(quiet: bool) -> Self {
        Self { bar: bar(quiet, PARTS, "{bar:30} {percent:>3} %  {msg}") }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Shows on a terminal what a long measurement is at; tables grow above.
pub struct Steps {
    bar: Option<ProgressBar>,
}

impl Steps {
    /// With a bar if stderr is a terminal and not `quiet`.
    pub fn new(quiet: bool) -> Self {
        let bar = bar(quiet, 1, "{spinner} {bar:30} {elapsed:>4}  {msg}");
        if let Some(bar) = &bar {
            bar.enable_steady_tick(Duration::from_millis(200));
        }
        Self { bar }
    }

    /// Goes on to something of so many parts, or of none that can be told apart.
    pub fn begin(&self, what: impl Display, parts: u64) {
        if let Some(bar) = &self.bar {
            bar.reset();
            bar.set_length(parts.max(1));
            bar.set_message(what.to_string());
        }
    }

    /// So many parts more are done.
    pub fn advance(&self, parts: u64) {
        if let Some(bar) = &self.bar {
            bar.inc(parts);
        }
    }

    /// Says something that stays.
    pub fn above(&self, say: impl FnOnce()) {
        match &self.bar {
            Some(bar) => bar.suspend(say),
            None => say(),
        }
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Observer for Watcher {
    fn progress(&self, progress: &Progress) {
        if let Some(bar) = &self.bar {
            bar.set_position((progress.done.clamp(0.0, 1.0) * PARTS as f64) as u64);
            bar.set_message(message(progress));
        }
    }

    fn cancelled(&self) -> bool {
        interrupt::asked()
    }
}

/// Samples, speed and remaining time.
fn message(progress: &Progress) -> String {
    let speed = progress.rays as f64 / progress.seconds.max(1e-9) * 1e-6;
    let left = progress.seconds * (1.0 - progress.done) / progress.done;
    let left = match Duration::try_from_secs_f64(left) {
        Ok(left) if progress.done > 0.0 => format!("{} left", HumanDuration(left)),
        _ => "…".into(),
    };
    format!("{:.1} spp  {speed:.2} Mrays/s  {left}", progress.spp)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quarter done in 10 s: 30 s are left; 20 million rays in 10 s are 2 a microsecond.
    #[test]
    fn the_bar_tells_samples_speed_and_what_is_left() {
        let progress = Progress { spp: 16.0, done: 0.25, rays: 20_000_000, seconds: 10.0 };
        assert_eq!(message(&progress), "16.0 spp  2.00 Mrays/s  30 seconds left");
        assert_eq!(message(&Progress::default()), "0.0 spp  0.00 Mrays/s  …");
    }
}
