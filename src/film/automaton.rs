//! A machine that tells which light path expressions a path is as.

use std::collections::HashMap;

use regex_automata::{
    Anchored, MatchKind,
    dfa::{Automaton as _, StartKind, dense},
    nfa::thompson,
    util::{start, syntax},
};

use super::expression::{Expression, ExpressionError};

/// What a surface does to light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Reflects it to all sides.
    DiffuseReflection,
    /// Reflects it by facets.
    GlossyReflection,
    /// Reflects it as a mirror.
    SingularReflection,
    /// Lets it through to all sides. Nothing does so far.
    DiffuseTransmission,
    /// Lets it through by facets.
    GlossyTransmission,
    /// Lets it through without blur.
    SingularTransmission,
}

/// Kinds of [`Event`].
const EVENTS: usize = 6;
/// Symbols of the sky and of a lamp without a name of its own; those with one come behind.
pub(super) const SKY: usize = EVENTS;
pub(super) const LAMP: usize = EVENTS + 1;
/// Symbols at most: their set is a word.
pub(super) const MOST_SYMBOLS: usize = 64;
pub(super) const SCATTERINGS: u64 = (1 << EVENTS) - 1;
/// States at most: of each path the ledger keeps some of 16 bits.
const MOST_STATES: usize = 1 << 15;
/// Bytes that it may take to make them.
const MOST_BYTES: usize = 64 << 20;

/// What stands for a symbol in the regular expression.
pub(super) fn byte(symbol: usize) -> u8 {
    symbol as u8 + b'0'
}

/// A machine that reads paths from the camera on, for several expressions at once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Automaton {
    /// By state and event.
    next: Vec<[u16; EVENTS]>,
    /// By light, its symbol.
    of_light: Vec<u8>,
    /// Symbols of lights.
    terminals: usize,
    /// By state and symbol of the light, the expressions that are met: rows of `met`.
    met_from: Vec<u32>,
    met: Vec<u16>,
}

impl Automaton {
    /// For lights with such keys, `u64::MAX` being the environment.
    ///
    /// # Errors
    ///
    /// Expressions whose machine would be too large.
    pub fn new(expressions: &[&Expression], lights: &[u64]) -> Result<Self, ExpressionError> {
        let told = || expressions.iter().map(|expression| expression.text.as_str()).collect::<Vec<_>>().join(", ");
        let failed = |problem: String| ExpressionError { text: told(), problem, at: 0 };
        // Lights that the same names stand for are one symbol.
        let names: Vec<&Vec<u64>> = expressions.iter().flat_map(|e| e.lights.iter().map(|(_, keys)| keys)).collect();
        let mut kinds: HashMap<Vec<bool>, usize> = HashMap::new();
        let mut keys_of: Vec<Vec<u64>> = Vec::new();
        let mut of_light = Vec::new();
        for &key in lights {
            let kind: Vec<bool> = names.iter().map(|keys| keys.contains(&key)).collect();
            if key == u64::MAX {
                of_light.push(SKY);
            } else if !kind.contains(&true) {
                of_light.push(LAMP);
            } else {
                let next = LAMP + 1 + kinds.len();
                let symbol = *kinds.entry(kind).or_insert(next);
                keys_of.resize(keys_of.len().max(symbol - LAMP), Vec::new());
                keys_of[symbol - LAMP - 1].push(key);
                of_light.push(symbol);
            }
        }
        let symbols = LAMP + 1 + keys_of.len();
        if symbols > MOST_SYMBOLS {
            return Err(failed(format!("at most {} lights can be told apart", MOST_SYMBOLS - LAMP - 1)));
        }
        let symbols_of = |keys: &[u64]| {
            let has = |row: &usize| keys_of[*row].iter().any(|key| keys.contains(key));
            let sky = keys.contains(&u64::MAX).then_some(SKY);
            (0..keys_of.len()).filter(has).map(|row| LAMP + 1 + row).chain(sky).collect()
        };
        let patterns: Vec<String> = expressions.iter().map(|e| e.pattern(symbols, symbols_of)).collect();
        let config = dense::Config::new()
            .match_kind(MatchKind::All)
            .start_kind(StartKind::Anchored)
            .dfa_size_limit(Some(MOST_BYTES))
            .determinize_size_limit(Some(MOST_BYTES));
        let too_many = || failed("too many states: fewer or shorter expressions at a time".into());
        let dfa = dense::Builder::new()
            .configure(config)
            .thompson(thompson::Config::new().nfa_size_limit(Some(MOST_BYTES)))
            .syntax(syntax::Config::new().unicode(false).utf8(false))
            .build_many(&patterns)
            .map_err(|_| too_many())?;
        let start = dfa.start_state(&start::Config::new().anchored(Anchored::Yes)).map_err(|_| too_many())?;
        let terminals = symbols - SKY;
        let (mut states, mut next) = (vec![start], Vec::new());
        let mut rows: HashMap<_, u16> = HashMap::from([(start, 0)]);
        let (mut met_from, mut met) = (vec![0], Vec::new());
        let mut at = 0;
        while at < states.len() {
            let state = states[at];
            at += 1;
            let mut events = [0; EVENTS];
            for (event, to) in events.iter_mut().enumerate() {
                let id = dfa.next_state(state, byte(event));
                *to = *rows.entry(id).or_insert_with(|| {
                    states.push(id);
                    (states.len() - 1) as u16
                });
            }
            if states.len() > MOST_STATES {
                return Err(too_many());
            }
            next.push(events);
            for symbol in SKY..symbols {
                let end = dfa.next_eoi_state(dfa.next_state(state, byte(symbol)));
                if dfa.is_match_state(end) {
                    met.extend((0..dfa.match_len(end)).map(|i| dfa.match_pattern(end, i).as_u32() as u16));
                }
                met_from.push(met.len() as u32);
            }
        }
        Ok(Self { next, of_light: of_light.into_iter().map(|s| (s - SKY) as u8).collect(), terminals, met_from, met })
    }

    /// Where paths begin.
    pub const START: u16 = 0;

    /// After a further event.
    #[inline]
    pub fn after(&self, state: u16, event: Event) -> u16 {
        self.next[usize::from(state)][event as usize]
    }

    fn accepted_by(&self, state: u16, terminal: usize) -> &[u16] {
        let row = usize::from(state) * self.terminals + terminal;
        &self.met[self.met_from[row] as usize..self.met_from[row + 1] as usize]
    }

    /// True if some path is as some expression says.
    pub(super) fn accepts_any(&self) -> bool {
        !self.met.is_empty()
    }

    /// The expressions that a path is as, which ends at a light.
    #[inline]
    pub fn met(&self, state: u16, light: u32) -> &[u16] {
        let terminal = self.of_light.get(light as usize).copied().unwrap_or(0);
        self.accepted_by(state, usize::from(terminal))
    }
}
