//! Light path expressions: regular expressions over what happens to light between a lamp and the camera (Heckbert 1990, "Adaptive
//! Radiosity Textures for Bidirectional Ray Tracing", section 2.3; in the notation of Open Shading Language, "Light Path
//! Expressions").
//!
//! Paths are read from the camera. `C` is the camera and comes first, then a symbol for each scattering, last the light:
//!
//! | | |
//! |---|---|
//! | `D`, `G`, `S` | scattered diffusely, by rough facets (glossy), by a mirror or clear glass (singular) |
//! | `R`, `T` | reflected, transmitted |
//! | `<RD>`, `<T[GS]>`, `<.S>` | both: how and what |
//! | `L` | a lamp: a surface that shines, a point light, spot or directional light; `<L.'name'>` a certain one |
//! | `B` | the background: the environment |
//! | `.` | anything |
//! | `[DG]`, `[^S]` | any of these, any scattering but these |
//! | `*`, `+`, `?`, `{2}`, `{2,}`, `{2,4}`, `(…)`, `\|` | as in regular expressions |
//!
//! So `C[LB]` is what the camera sees of lights, `CDL` direct light on matt surfaces, `C.*D<T.>+L` light that came through glass onto
//! something matt, `CS+D.*L` what mirrors and glass show of matt things.

use std::collections::HashMap;

use regex_automata::{
    Anchored, MatchKind,
    dfa::{Automaton as _, StartKind, dense},
    util::{start, syntax},
};

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
const SKY: usize = EVENTS;
const LAMP: usize = EVENTS + 1;
/// Symbols at most: their set is a word.
const MOST_SYMBOLS: usize = 64;
const SCATTERINGS: u64 = (1 << EVENTS) - 1;
/// States at most: of each path the ledger keeps some of 16 bits.
const MOST_STATES: usize = 1 << 15;
/// Bytes that it may take to make them.
const MOST_BYTES: usize = 64 << 20;

/// What is wrong with an expression, and at which character.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text}: {problem} (character {})", at + 1)]
pub struct ExpressionError {
    /// The expression.
    pub text: String,
    /// What is wrong with it.
    pub problem: String,
    /// Characters before it.
    pub at: usize,
}

/// One of some symbols, or what joins those.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Piece {
    /// Symbols; of lights with names, rows of the expression's own.
    Any { symbols: u64, named: Vec<usize> },
    /// All lights but these.
    AnyLightBut { symbols: u64, named: Vec<usize> },
    /// As in the regular expression.
    Operator(String),
}

/// A description of paths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Expression {
    text: String,
    pieces: Vec<Piece>,
    /// Lights that it names, and keys of entities that have the name.
    lights: Vec<(String, Vec<u64>)>,
}

/// Of letters, what a scattering may be.
fn scatterings(letter: char) -> Option<u64> {
    let of = |events: &[Event]| Some(events.iter().fold(0, |bits, &event| bits | 1 << event as u32));
    use Event::{
        DiffuseReflection, DiffuseTransmission, GlossyReflection, GlossyTransmission, SingularReflection,
        SingularTransmission,
    };
    match letter {
        'D' => of(&[DiffuseReflection, DiffuseTransmission]),
        'G' => of(&[GlossyReflection, GlossyTransmission]),
        'S' => of(&[SingularReflection, SingularTransmission]),
        'R' => of(&[DiffuseReflection, GlossyReflection, SingularReflection]),
        'T' => of(&[DiffuseTransmission, GlossyTransmission, SingularTransmission]),
        '.' => Some(SCATTERINGS),
        _ => None,
    }
}

/// Reads an expression from its characters.
struct Reader<'a> {
    text: &'a str,
    chars: Vec<char>,
    at: usize,
    lights: Vec<(String, Vec<u64>)>,
}

impl Reader<'_> {
    fn error<T>(&self, at: usize, problem: impl Into<String>) -> Result<T, ExpressionError> {
        Err(ExpressionError { text: self.text.to_owned(), problem: problem.into(), at })
    }

    fn peek(&self) -> Option<char> {
        self.chars.get(self.at).copied()
    }

    /// Scatterings of a letter or of letters in brackets, as between `<` and `>`.
    fn part(&mut self) -> Result<u64, ExpressionError> {
        let start = self.at;
        let mut bits = 0;
        let in_brackets = self.peek() == Some('[');
        self.at += usize::from(in_brackets);
        let but = in_brackets && self.peek() == Some('^');
        self.at += usize::from(but);
        loop {
            match self.peek() {
                Some(']') if in_brackets && bits != 0 => {
                    self.at += 1;
                    break;
                }
                Some(letter) => match scatterings(letter) {
                    Some(more) => {
                        bits |= more;
                        self.at += 1;
                    }
                    None => return self.error(self.at, format!("{letter:?} is none of D, G, S, R, T or .")),
                },
                None => return self.error(start, "it ends within < >"),
            }
            if !in_brackets {
                break;
            }
        }
        Ok(if but { SCATTERINGS & !bits } else { bits })
    }

    /// Of `<RD>` or `<L.'name'>`, what it stands for; from behind the `<`.
    fn event(&mut self) -> Result<(u64, Option<usize>), ExpressionError> {
        let start = self.at;
        if self.peek() == Some('L') {
            self.at += 1;
            let rest: String = self.chars[self.at..].iter().collect();
            if rest.starts_with('>') {
                self.at += 1;
                return Ok((1 << LAMP, None));
            }
            let name = rest.strip_prefix(".'").and_then(|rest| rest.split_once("'>")).map(|(name, _)| name);
            let Some(name) = name else {
                return self.error(start, "a lamp with a name is written <L.'name'>");
            };
            self.at += name.chars().count() + 4;
            let known = self.lights.iter().position(|(other, _)| other == name);
            let row = known.unwrap_or_else(|| {
                self.lights.push((name.to_owned(), name.parse().into_iter().collect()));
                self.lights.len() - 1
            });
            return Ok((0, Some(row)));
        }
        let bits = self.part()? & self.part()?;
        if self.peek() != Some('>') {
            return self.error(start, "between < and > there are two parts, such as <RD>, <T[GS]> or <.S>");
        }
        self.at += 1;
        if bits == 0 {
            return self.error(start, "nothing is both, so it stands for no path; first R or T, then D, G or S");
        }
        Ok((bits, None))
    }

    /// A symbol outside of brackets, or within them.
    fn symbol(&mut self, letter: char) -> Result<(u64, Option<usize>), ExpressionError> {
        self.at += 1;
        match letter {
            'L' => Ok((1 << LAMP, None)),
            'B' => Ok((1 << SKY, None)),
            '<' => self.event(),
            _ => match scatterings(letter) {
                Some(bits) => Ok((bits, None)),
                None if letter == 'C' => {
                    self.error(self.at - 1, "C, the camera, is where paths begin; write C(DL|SL) for CDL|CSL")
                }
                None if letter == 'O' => self.error(self.at - 1, "surfaces that shine are L as well"),
                None => self.error(self.at - 1, format!("{letter:?} has no meaning here")),
            },
        }
    }

    /// From behind a `[`.
    fn set(&mut self) -> Result<Piece, ExpressionError> {
        let start = self.at - 1;
        let but = self.peek() == Some('^');
        self.at += usize::from(but);
        let (mut symbols, mut named, mut any) = (0, Vec::new(), false);
        loop {
            match self.peek() {
                None => return self.error(start, "the [ is not closed"),
                Some(']') => break,
                Some(letter) => {
                    let (bits, row) = self.symbol(letter)?;
                    symbols |= bits;
                    named.extend(row);
                    any = true;
                }
            }
        }
        self.at += 1;
        if !any {
            return self.error(start, "there is nothing between [ and ]");
        }
        let lights = symbols & !SCATTERINGS != 0 || !named.is_empty();
        Ok(match but {
            true if lights && symbols & SCATTERINGS != 0 => {
                return self.error(start, "[^…] takes scatterings or lights, not both");
            }
            true if lights => Piece::AnyLightBut { symbols, named },
            true => Piece::Any { symbols: SCATTERINGS & !symbols, named },
            false => Piece::Any { symbols, named },
        })
    }

    /// From behind a `{`.
    fn count(&mut self) -> Result<Piece, ExpressionError> {
        let start = self.at - 1;
        let rest: String = self.chars[self.at..].iter().collect();
        let inside = rest.split_once('}').map_or("", |(inside, _)| inside);
        let numbers: Option<Vec<Option<u32>>> =
            inside.split(',').map(|n| if n.is_empty() { Some(None) } else { n.parse().ok().map(Some) }).collect();
        let right = match numbers.as_deref() {
            Some([Some(n)]) => *n <= 99,
            Some([Some(n), None]) => *n <= 99,
            Some([Some(least), Some(most)]) => least <= most && *most <= 99,
            _ => false,
        };
        if !right {
            return self.error(start, "a number of times is written {2}, {2,} or {2,4}, and is at most 99");
        }
        self.at += inside.len() + 1;
        Ok(Piece::Operator(format!("{{{inside}}}")))
    }
}

impl std::str::FromStr for Expression {
    type Err = ExpressionError;

    fn from_str(text: &str) -> Result<Self, ExpressionError> {
        let text = text.trim();
        let chars: Vec<char> = text.chars().filter(|c| !c.is_whitespace()).collect();
        // Names may hold spaces.
        let chars = if text.contains('\'') { text.chars().collect() } else { chars };
        let mut reader = Reader { text, chars, at: 0, lights: Vec::new() };
        if reader.peek() != Some('C') {
            return reader.error(0, "it does not begin with C, the camera, such as CDL");
        }
        reader.at = 1;
        let mut pieces = Vec::new();
        let mut open = Vec::new();
        // Something that can be repeated comes before.
        let mut repeats = false;
        while let Some(letter) = reader.peek() {
            let at = reader.at;
            let operator = |letter: char| Piece::Operator(letter.to_string());
            let (piece, then_repeats) = match letter {
                ' ' => {
                    reader.at += 1;
                    continue;
                }
                '(' => {
                    reader.at += 1;
                    open.push(at);
                    (Piece::Operator("(?:".into()), false)
                }
                ')' => {
                    reader.at += 1;
                    if open.pop().is_none() {
                        return reader.error(at, "there is no ( before");
                    }
                    (operator(letter), true)
                }
                '|' => {
                    reader.at += 1;
                    (operator(letter), false)
                }
                '*' | '+' | '?' | '{' => {
                    reader.at += 1;
                    if !repeats {
                        return reader.error(at, "there is nothing before it to repeat");
                    }
                    (if letter == '{' { reader.count()? } else { operator(letter) }, false)
                }
                '[' => {
                    reader.at += 1;
                    (reader.set()?, true)
                }
                '.' => {
                    reader.at += 1;
                    (Piece::AnyLightBut { symbols: SCATTERINGS, named: Vec::new() }, true)
                }
                _ => {
                    let (symbols, named) = reader.symbol(letter)?;
                    (Piece::Any { symbols, named: named.into_iter().collect() }, true)
                }
            };
            pieces.push(piece);
            repeats = then_repeats;
        }
        if let Some(at) = open.pop() {
            return reader.error(at, "the ( is not closed");
        }
        let expression = Self { text: text.to_owned(), pieces, lights: reader.lights };
        // One that no path fits, whatever the scene, would be a black layer that nobody asked for.
        let keys: Vec<u64> = (0..expression.lights.len() as u64).chain([u64::MAX - 1, u64::MAX]).collect();
        let numbers = expression.lights.iter().zip(&keys).map(|((name, _), &key)| (name.clone(), vec![key]));
        let numbered = Self { lights: numbers.collect(), ..expression.clone() };
        let automaton = Automaton::new(&[&numbered], &keys)?;
        let is_met = (0..automaton.next.len() as u16)
            .any(|state| (0..automaton.terminals).any(|terminal| !automaton.accepted_by(state, terminal).is_empty()));
        if !is_met {
            let problem = "no path is as it says: the last symbol is a light, L or B, and none comes before";
            return Err(ExpressionError { text: text.to_owned(), problem: problem.into(), at: text.chars().count() });
        }
        Ok(expression)
    }
}

impl std::fmt::Display for Expression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

impl Expression {
    /// Finds the entities of the lights that it names: `find` has their keys, none if there is no such light.
    ///
    /// # Errors
    ///
    /// The first name that nothing has.
    pub fn resolve(&mut self, find: impl Fn(&str) -> Vec<u64>) -> Result<(), String> {
        for (name, keys) in &mut self.lights {
            let found = find(name);
            if found.is_empty() {
                return Err(name.clone());
            }
            *keys = found;
        }
        Ok(())
    }

    /// As a regular expression of bytes; `symbol` is that of a named light.
    fn pattern(&self, symbols: usize, symbol: impl Fn(&[u64]) -> Vec<usize>) -> String {
        let class = |bits: u64| {
            let members = (0..symbols).filter(|&symbol| bits >> symbol & 1 == 1);
            let members: String = members.map(|symbol| format!("\\x{:02x}", byte(symbol))).collect();
            // A name that no light of the scene has.
            if members.is_empty() { "[a&&b]".into() } else { format!("[{members}]") }
        };
        let lights = (u64::MAX >> (MOST_SYMBOLS - symbols)) & !SCATTERINGS;
        let with = |bits: u64, named: &[usize]| {
            let mut bits = bits;
            if bits >> LAMP & 1 == 1 {
                // Those that other expressions name are lamps too.
                bits |= lights & !(1 << SKY);
            }
            named.iter().flat_map(|&row| symbol(&self.lights[row].1)).fold(bits, |bits, symbol| bits | 1 << symbol)
        };
        let pieces = self.pieces.iter().map(|piece| match piece {
            Piece::Any { symbols, named } => class(with(*symbols, named)),
            Piece::AnyLightBut { symbols, .. } if *symbols == SCATTERINGS => class(SCATTERINGS | lights),
            Piece::AnyLightBut { symbols, named } => class(lights & !with(*symbols, named)),
            Piece::Operator(text) => text.clone(),
        });
        format!("(?:{})", pieces.collect::<String>())
    }
}

/// What stands for a symbol in the regular expression.
fn byte(symbol: usize) -> u8 {
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

    /// The expressions that a path is as, which ends at a light.
    #[inline]
    pub fn met(&self, state: u16, light: u32) -> &[u16] {
        let terminal = self.of_light.get(light as usize).copied().unwrap_or(0);
        self.accepted_by(state, usize::from(terminal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEYS: [u64; 4] = [3, 7, 9, u64::MAX];

    fn event(name: &str) -> Event {
        match name {
            "RD" => Event::DiffuseReflection,
            "RG" => Event::GlossyReflection,
            "RS" => Event::SingularReflection,
            "TG" => Event::GlossyTransmission,
            "TS" => Event::SingularTransmission,
            _ => panic!("{name}"),
        }
    }

    /// Which of some expressions a path is as.
    fn met(expressions: &[&str], path: &str, light: u32) -> Vec<u16> {
        let parsed: Vec<Expression> = expressions.iter().map(|text| text.parse().expect("it is right")).collect();
        let automaton = Automaton::new(&parsed.iter().collect::<Vec<_>>(), &KEYS).expect("it is small");
        let state = path.split_whitespace().fold(Automaton::START, |state, name| automaton.after(state, event(name)));
        let mut met = automaton.met(state, light).to_vec();
        met.sort_unstable();
        met
    }

    #[test]
    fn paths_are_told_apart_by_what_happened_to_them() {
        let all = ["C[LB]", "CDL", "C.*D<T.>+L", "CS+D.*L", "C.*", "C<.[SG]>.{1,2}B", "C[^D]*.", "C(DD|SS)L"];
        for (path, light, want) in [
            ("", 0, vec![0, 4, 6]),
            ("", 3, vec![0, 4, 6]),
            ("RD", 1, vec![1, 4]),
            ("RD", 3, vec![4]),
            ("RD TS TS", 0, vec![2, 4]),
            ("TS RD RG", 0, vec![3, 4]),
            ("RG RD", 3, vec![4, 5]),
            ("RG RG RS", 3, vec![4, 5, 6]),
            ("RG RG RS RS", 3, vec![4, 6]),
            ("RD RD", 0, vec![4, 7]),
            ("RS TS", 2, vec![4, 6, 7]),
        ] {
            assert_eq!(met(&all, path, light), want, "{path} {light}");
        }
    }

    #[test]
    fn lamps_have_names_and_are_lamps_all_the_same() {
        let all = ["CD<L.'7'>", "CDL", "CD[^<L.'7'>]", "CD[<L.'9'>B]", "CD[^B]"];
        for (light, want) in [(0, vec![1, 2, 4]), (1, vec![0, 1, 4]), (2, vec![1, 2, 3, 4]), (3, vec![2, 3])] {
            assert_eq!(met(&all, "RD", light), want, "{light}");
        }
        let mut named: Expression = "C D <L.'the lamp'> | B".parse().expect("it is right");
        assert_eq!(named.to_string(), "C D <L.'the lamp'> | B");
        assert_eq!(named.resolve(|_| Vec::new()), Err("the lamp".to_owned()));
        named.resolve(|name| if name == "the lamp" { vec![3, 9] } else { Vec::new() }).expect("it is there");
        let automaton = Automaton::new(&[&named], &KEYS).expect("it is small");
        let state = automaton.after(Automaton::START, Event::DiffuseReflection);
        assert_eq!([0, 1, 2, 3].map(|light| automaton.met(state, light).len()), [1, 0, 1, 0]);
        // The environment may have a name too.
        named.resolve(|_| vec![u64::MAX]).expect("it is there");
        let automaton = Automaton::new(&[&named], &KEYS).expect("it is small");
        assert_eq!([0, 1, 2, 3].map(|light| automaton.met(state, light).len()), [0, 0, 0, 1]);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        for (text, at, problem) in [
            ("", 0, "begin with C"),
            ("DL", 0, "begin with C"),
            ("CDL|CSL", 4, "write C(DL|SL)"),
            ("CXL", 1, "no meaning"),
            ("CO", 1, "L as well"),
            ("C*L", 1, "nothing before"),
            ("C(DL", 1, "not closed"),
            ("CD)L", 2, "no ("),
            ("C[DL", 1, "not closed"),
            ("C[]L", 1, "nothing between"),
            ("C[^DL]", 1, "not both"),
            ("C<DR", 4, "two parts"),
            ("C<R>L", 3, "none of"),
            ("C<RT>L", 2, "nothing is both"),
            ("C<L.lamp>", 2, "<L.'name'>"),
            ("CD{3,2}L", 2, "{2,4}"),
            ("CD{x}L", 2, "{2,4}"),
            ("CD", 2, "last symbol is a light"),
            ("CLD", 3, "last symbol is a light"),
        ] {
            let error = text.parse::<Expression>().expect_err(text);
            assert!(error.problem.contains(problem), "{text}: {error}");
            if text != "C<DR" {
                assert_eq!(error.at, at, "{error}");
            }
        }
    }

    /// A machine of too many states is refused, and soon.
    #[test]
    fn what_needs_too_many_states_is_refused() {
        let error = "C.*D.{15}L".parse::<Expression>().expect_err("it is too long");
        assert!(error.problem.contains("too many states"), "{error}");
        let short: Expression = "C.*D.{5}L".parse().expect("this is not");
        assert!(Automaton::new(&[&short], &KEYS).is_ok());
    }
}
