//! Bytes of a good file, spoilt in the ways in which files are spoilt; the same every time.
//!
//! Random bytes never reach the second line of a text parser; a good file with some wounds does. What a test finds is shrunk to
//! the fewest wounds. (bolero mutates only under an engine of its own; on the stable toolchain alone it draws from nothing.)

use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseResult, TestRng, TestRunner};

/// Words that parsers trip over.
const WORDS: [&[u8]; 24] = [
    b"nan",
    b"inf",
    b"-inf",
    b"-0.0",
    b"1e308",
    b"-1e-320",
    b"9223372036854775807",
    b"-9223372036854775808",
    b"99999999999999999999999",
    b"0",
    b",",
    b",,,,,,,,",
    b"\n",
    b"\r\n",
    b"\"",
    b"'''",
    b"[",
    b"]]",
    b"{a=",
    b"=",
    b"#",
    b"\0",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
];

/// One wound. Places are shares of the length, so that they stay where they are while others are taken away.
#[derive(Clone, Copy, Debug)]
pub enum Wound {
    Bit { at: u16, bit: u8 },
    Byte { at: u16, byte: u8 },
    Word { at: u16, word: usize },
    Digit { at: u16, digit: u8 },
    Delete { at: u16, length: u16 },
    Repeat { at: u16, length: u16, times: u8 },
    Move { at: u16, length: u16, to: u16 },
    Truncate { at: u16 },
}

impl Wound {
    fn inflict(self, bytes: &mut Vec<u8>) {
        let place = |at: u16, length: usize| usize::from(at) * length / (usize::from(u16::MAX) + 1);
        let length_of = bytes.len();
        let piece = |at: u16, length: u16| {
            let from = place(at, length_of);
            from..(from + 1 + usize::from(length) % 64).min(length_of)
        };
        if bytes.is_empty() {
            return;
        }
        match self {
            Wound::Bit { at, bit } => bytes[place(at, length_of)] ^= 1 << (bit % 8),
            Wound::Byte { at, byte } => bytes[place(at, length_of)] = byte,
            Wound::Word { at, word } => {
                let at = place(at, length_of);
                bytes.splice(at..at, WORDS[word % WORDS.len()].iter().copied());
            }
            // The next digit, so that numbers stay numbers.
            Wound::Digit { at, digit } => {
                let from = place(at, length_of);
                if let Some(found) = bytes[from..].iter_mut().find(|byte| byte.is_ascii_digit()) {
                    *found = b'0' + digit % 10;
                }
            }
            Wound::Delete { at, length } => drop(bytes.drain(piece(at, length))),
            Wound::Repeat { at, length, times } => {
                let repeated = bytes[piece(at, length)].repeat(usize::from(times));
                let at = place(at, length_of);
                bytes.splice(at..at, repeated);
            }
            Wound::Move { at, length, to } => {
                let moved: Vec<u8> = bytes.drain(piece(at, length)).collect();
                let to = place(to, bytes.len());
                bytes.splice(to..to, moved);
            }
            Wound::Truncate { at } => bytes.truncate(place(at, length_of)),
        }
    }
}

fn any_wound() -> impl Strategy<Value = Wound> {
    let at = || any::<u16>();
    prop_oneof![
        2 => (at(), any::<u8>()).prop_map(|(at, bit)| Wound::Bit { at, bit }),
        1 => (at(), any::<u8>()).prop_map(|(at, byte)| Wound::Byte { at, byte }),
        4 => (at(), 0..WORDS.len()).prop_map(|(at, word)| Wound::Word { at, word }),
        4 => (at(), any::<u8>()).prop_map(|(at, digit)| Wound::Digit { at, digit }),
        2 => (at(), any::<u16>()).prop_map(|(at, length)| Wound::Delete { at, length }),
        1 => (at(), any::<u16>(), any::<u8>()).prop_map(|(at, length, times)| Wound::Repeat { at, length, times }),
        2 => (at(), any::<u16>(), at()).prop_map(|(at, length, to)| Wound::Move { at, length, to }),
        1 => at().prop_map(|at| Wound::Truncate { at }),
    ]
}

/// Runs `check` on anything drawn from `drawn`, `executions` times, and says so.
pub fn fuzz<T: core::fmt::Debug>(
    parser: &str,
    executions: u32,
    drawn: impl Strategy<Value = T>,
    check: impl Fn(T) -> TestCaseResult,
) {
    let config = Config { cases: executions, failure_persistence: None, ..Config::default() };
    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let begun = std::time::Instant::now();
    if let Err(failure) = TestRunner::new_with_rng(config, rng).run(&drawn, check) {
        panic!("{parser}: {failure}");
    }
    eprintln!("fuzz: {parser}: {executions} executions in {:.1} s", begun.elapsed().as_secs_f64());
}

/// A spoilt file.
#[derive(Clone)]
pub struct Spoilt {
    /// Which of the corpus it was.
    pub index: usize,
    /// What is left of it.
    pub bytes: Vec<u8>,
}

/// As text, for whoever reads what a test has found.
impl core::fmt::Debug for Spoilt {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "file {}: \"{}\"", self.index, self.bytes.escape_ascii())
    }
}

/// One of the corpus with one to six wounds.
pub fn wounded(corpus: Vec<Vec<u8>>) -> impl Strategy<Value = Spoilt> {
    (0..corpus.len(), prop::collection::vec(any_wound(), 1..=6)).prop_map(move |(index, wounds)| {
        let mut bytes = corpus[index].clone();
        wounds.into_iter().for_each(|wound| wound.inflict(&mut bytes));
        Spoilt { index, bytes }
    })
}
