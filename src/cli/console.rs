//! What is said and where.

use std::{
    fmt::Display,
    io::{self, Write},
};

use serde_json::Value;

/// Says things on stderr and counts the warnings; hands results to stdout.
pub struct Console {
    quiet: bool,
    json: bool,
    warnings: Vec<String>,
}

impl Console {
    /// Without anything on stderr if `quiet`, with results as JSON if `json`.
    pub fn new(quiet: bool, json: bool) -> Self {
        Self { quiet, json, warnings: Vec::new() }
    }

    /// True if only errors are to be shown.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Says something that the user may want to do something about, and counts it.
    pub fn warn(&mut self, text: impl Display) {
        let text = text.to_string();
        if !self.quiet {
            eprintln!("warning: {text}");
        }
        self.warnings.push(text);
    }

    /// Says something that is worth knowing.
    pub fn note(&self, text: impl Display) {
        if !self.quiet {
            eprintln!("note: {text}");
        }
    }

    /// All warnings so far.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Hands over the result: `text` for people or `json` for programs.
    ///
    /// A reader that has closed the pipe has what it wanted, so failure to write is none.
    pub fn result(&self, text: &str, json: impl FnOnce() -> Value) {
        let mut stdout = io::stdout().lock();
        let _ = match self.json {
            true => writeln!(stdout, "{:#}", json()),
            false => writeln!(stdout, "{}", text.trim_end()),
        };
    }

    /// Hands over a part of the result as soon as it is known, for people; programs get all of it at the [end](Self::end).
    pub fn part(&self, text: &str) {
        if !self.json {
            let _ = writeln!(io::stdout().lock(), "{}", text.trim_end());
        }
    }

    /// Hands over for programs what people got in [parts](Self::part).
    pub fn end(&self, json: impl FnOnce() -> Value) {
        if self.json {
            let _ = writeln!(io::stdout().lock(), "{:#}", json());
        }
    }

    /// True if results are wanted as JSON.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Says how many warnings there were.
    pub fn finish(&self) {
        match self.warnings.len() {
            _ if self.quiet => {}
            0 => {}
            1 => eprintln!("1 warning"),
            count => eprintln!("{count} warnings"),
        }
    }
}
