//! What goes wrong, for which sensor, when: `sensor.class[=value[,value]][@[from]..[to]]`.

use std::fmt;
use std::str::FromStr;

use shared_types::{SENSORS, Sensor, Time};

use crate::class::{CLASSES, Class};

/// Data time in which a fault acts: from its beginning up to, and without, its end. Without one of them it is open there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// First instant.
    pub from: Option<Time>,
    /// First instant after it.
    pub to: Option<Time>,
}

impl Span {
    /// Always.
    pub const OPEN: Span = Span { from: None, to: None };

    /// Whether it holds an instant.
    pub fn holds(&self, t: Time) -> bool {
        self.from.is_none_or(|from| from <= t) && self.to.is_none_or(|to| t < to)
    }
}

/// One fault as it is asked for. Made by parsing; what it prints parses to the same.
#[derive(Clone)]
pub struct FaultSpec {
    pub(crate) sensor: Sensor,
    pub(crate) class: &'static Class,
    /// One for each value of the class.
    pub(crate) values: Vec<f64>,
    pub(crate) span: Span,
}

impl FaultSpec {
    /// Whose readings.
    pub fn sensor(&self) -> Sensor {
        self.sensor
    }

    /// `multipath`, `false_lock`, ...
    pub fn class(&self) -> &'static str {
        self.class.name
    }

    /// Its values, those left out at their defaults, in the order of the table of classes.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// When.
    pub fn span(&self) -> Span {
        self.span
    }

    /// Entries of the fault catalogue that the class serves, such as `F6 F13`.
    pub fn catalogue(&self) -> &'static str {
        self.class.catalogue
    }
}

impl fmt::Debug for FaultSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "FaultSpec({self})")
    }
}

/// Equal if they print alike: NaN is a value like any other here.
impl PartialEq for FaultSpec {
    fn eq(&self, other: &FaultSpec) -> bool {
        self.to_string() == other.to_string()
    }
}

impl fmt::Display for FaultSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.sensor.name(), self.class.name)?;
        for (index, value) in self.values.iter().enumerate() {
            write!(f, "{}{value}", if index == 0 { "=" } else { "," })?;
        }
        let end = |t: Option<Time>| t.map_or_else(String::new, |t| t.to_string());
        write!(f, "@{}..{}", end(self.span.from), end(self.span.to))
    }
}

/// A text that is no fault, and what to write instead.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// Not of the form.
    #[error("fault {text:?}: expected sensor.class[=value[,value]][@from..to], such as dvl.false_lock@600..660")]
    Form {
        /// As written.
        text: String,
    },
    /// No such sensor.
    #[error("fault {text:?}: there is no sensor {sensor:?}; there are {}", SENSORS.map(Sensor::name).join(", "))]
    Sensor {
        /// As written.
        text: String,
        /// The part before the dot.
        sensor: String,
    },
    /// No such class for that sensor.
    #[error("fault {text:?}: {sensor} has no class {class:?}; it has {known}")]
    Class {
        /// As written.
        text: String,
        /// Whose.
        sensor: Sensor,
        /// The part after the dot.
        class: String,
        /// Those that exist.
        known: String,
    },
    /// More values than the class has.
    #[error("fault {text:?}: {given} values are given; write {usage}")]
    TooMany {
        /// As written.
        text: String,
        /// How many.
        given: usize,
        /// How the class is written.
        usage: String,
    },
    /// A value outside its domain.
    #[error("fault {text:?}: `{name}` is {found:?}; it must be {expected} ({usage})")]
    Value {
        /// As written.
        text: String,
        /// Which value.
        name: &'static str,
        /// What stands there.
        found: String,
        /// What may stand there.
        expected: &'static str,
        /// How the class is written.
        usage: String,
    },
    /// A span that is none.
    #[error(
        "fault {text:?}: the span {found:?} must be from..to in seconds, the earlier first; either may be left out"
    )]
    Span {
        /// As written.
        text: String,
        /// The part after the `@`.
        found: String,
    },
}

impl FromStr for FaultSpec {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<FaultSpec, FaultError> {
        let whole = || text.to_owned();
        let (what, span) = match text.split_once('@') {
            Some((what, span)) => (what, parse_span(text, span)?),
            None => (text, Span::OPEN),
        };
        let (name, values) = what.split_once('=').map_or((what, None), |(name, values)| (name, Some(values)));
        let (sensor, class) = name.split_once('.').ok_or_else(|| FaultError::Form { text: whole() })?;
        let (sensor, class) = (sensor.trim(), class.trim());
        let sensor =
            Sensor::from_name(sensor).ok_or_else(|| FaultError::Sensor { text: whole(), sensor: sensor.to_owned() })?;
        let class = Class::of(sensor, class).ok_or_else(|| FaultError::Class {
            text: whole(),
            sensor,
            class: class.to_owned(),
            known: known(sensor),
        })?;
        Ok(FaultSpec { sensor, class, values: parse_values(text, class, values)?, span })
    }
}

fn known(sensor: Sensor) -> String {
    let names: Vec<&str> =
        CLASSES.iter().filter(|class| class.sensors.contains(&sensor)).map(|class| class.name).collect();
    names.join(", ")
}

fn parse_span(text: &str, span: &str) -> Result<Span, FaultError> {
    let wrong = || FaultError::Span { text: text.to_owned(), found: span.to_owned() };
    let (from, to) = span.split_once("..").ok_or_else(wrong)?;
    let end = |end: &str| match end.trim() {
        "" => Ok(None),
        seconds => Time::parse(seconds.as_bytes()).map(Some).map_err(|_| wrong()),
    };
    let span = Span { from: end(from)?, to: end(to)? };
    match span {
        Span { from: Some(from), to: Some(to) } if from >= to => Err(wrong()),
        _ => Ok(span),
    }
}

fn parse_values(text: &str, class: &'static Class, given: Option<&str>) -> Result<Vec<f64>, FaultError> {
    let given: Vec<&str> = given.map_or_else(Vec::new, |values| values.split(',').map(str::trim).collect());
    if given.len() > class.values.len() {
        return Err(FaultError::TooMany { text: text.to_owned(), given: given.len(), usage: class.usage() });
    }
    class
        .values
        .iter()
        .enumerate()
        .map(|(index, &(name, domain, default))| match given.get(index) {
            None => Ok(default),
            Some(written) => {
                written.parse().ok().filter(|value| domain.holds(*value)).ok_or_else(|| FaultError::Value {
                    text: text.to_owned(),
                    name,
                    found: (*written).to_owned(),
                    expected: domain.expected(),
                    usage: class.usage(),
                })
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(text: &str) -> FaultSpec {
        text.parse().unwrap_or_else(|error: FaultError| panic!("{error}"))
    }

    fn error(text: &str) -> String {
        let error = text.parse::<FaultSpec>().expect_err("it is wrong").to_string();
        assert!(error.starts_with(&format!("fault {text:?}: ")) && !error.contains('\n'), "{error}");
        error
    }

    #[test]
    fn values_and_ends_left_out_are_the_defaults() {
        let full = spec("lbl.multipath=0.1,8,40@17.5..60");
        assert_eq!((full.sensor(), full.class(), full.values()), (Sensor::Lbl, "multipath", &[0.1, 8.0, 40.0][..]));
        assert_eq!(full.span(), Span { from: Some(Time(17_500_000_000)), to: Some(Time(60_000_000_000)) });
        assert_eq!(spec("lbl.multipath=0.1@..").values(), [0.1, 5.0, 300.0]);
        assert_eq!(spec("dvl.false_lock"), spec("dvl.false_lock@.."));
        assert_eq!(spec("gnss.jump@600..").span(), Span { from: Some(Time(600_000_000_000)), to: None });
        assert_eq!(spec("imu.blackout@..-3").span().to, Some(Time(-3_000_000_000)));
    }

    #[test]
    fn what_is_printed_parses_to_the_same() {
        for class in CLASSES {
            for sensor in class.sensors {
                let written = spec(&format!("{}.{}@1.25..1746099142.369755001", sensor.name(), class.name));
                assert_eq!(spec(&written.to_string()).to_string(), written.to_string());
            }
        }
        assert_eq!(spec("gnss.sigma=nan@5..").to_string(), "gnss.sigma=NaN@5..");
        assert_eq!(spec("gnss.sigma=NaN@5.."), spec("gnss.sigma=nan@5.."));
    }

    #[test]
    fn a_span_holds_its_first_instant_and_not_its_end() {
        let span = spec("ps.stuck@2..3").span();
        assert_eq!([1.999, 2.0, 2.999, 3.0].map(|t| span.holds(Time::from_seconds(t))), [false, true, true, false]);
        assert!(Span::OPEN.holds(Time::MIN) && Span::OPEN.holds(Time::MAX));
    }

    #[test]
    fn every_mistake_is_one_line_that_names_the_mend() {
        assert!(error("dvl").contains("expected sensor.class[=value[,value]][@from..to]"));
        assert!(error("sonar.stuck@1..2").contains("there are imu, lbl, gnss, dvl, mcp, ps, buoys"));
        assert!(error("dvl.multipath").contains("dvl has no class \"multipath\"; it has blackout, dropout,"));
        assert!(error("lbl.multipath=1,2,3,4").contains("4 values are given; write multipath=share,least m,most m"));
        assert!(error("lbl.multipath=1.5").contains("`share` is \"1.5\"; it must be a share between 0 and 1"));
        assert!(error("lbl.multipath=").contains("`share` is \"\""));
        assert!(error("lbl.silent=1.5").contains("it must be the number of a buoy"));
        assert!(error("dvl.stamp=nan").contains("it must be a finite number"));
        for span in ["5", "6..5", "5..5", "a..b", "1..2..3"] {
            assert!(error(&format!("dvl.stuck@{span}")).contains("must be from..to in seconds"), "{span}");
        }
    }
}
