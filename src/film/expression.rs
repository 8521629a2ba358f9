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

use super::automaton::{Automaton, Event, LAMP, MOST_SYMBOLS, SCATTERINGS, SKY, byte};

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
    pub(super) text: String,
    pieces: Vec<Piece>,
    /// Lights that it names, and keys of entities that have the name.
    pub(super) lights: Vec<(String, Vec<u64>)>,
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
    /// Without the blanks between symbols.
    chars: Vec<char>,
    /// Of each, the characters before it in the text.
    places: Vec<usize>,
    at: usize,
    lights: Vec<(String, Vec<u64>)>,
}

impl Reader<'_> {
    fn error<T>(&self, at: usize, problem: impl Into<String>) -> Result<T, ExpressionError> {
        let at = self.places.get(at).copied().unwrap_or_else(|| self.text.chars().count());
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
        let mut in_name = false;
        let counts = |&(_, c): &(usize, char)| {
            in_name ^= c == '\'';
            in_name || !c.is_whitespace()
        };
        let (places, chars) = text.chars().enumerate().filter(counts).unzip();
        let mut reader = Reader { text, chars, places, at: 0, lights: Vec::new() };
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
        if !automaton.accepts_any() {
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
    pub(super) fn pattern(&self, symbols: usize, symbol: impl Fn(&[u64]) -> Vec<usize>) -> String {
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
            ("C [D G] <L.'a b'> X", 18, "no meaning"),
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
        let error = "C(((.{99}){99}){99}){99}L".parse::<Expression>().expect_err("nor is there memory for this");
        assert!(error.problem.contains("too many states"), "{error}");
        let short: Expression = "C.*D.{5}L".parse().expect("this is not");
        assert!(Automaton::new(&[&short], &KEYS).is_ok());
    }
}
