//! Lines made of pieces, some of them in colour.

/// What a piece of text says beside its letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tone {
    Plain,
    Good,
    Warning,
    Bad,
}

impl Tone {
    /// Plain unless `holds`.
    pub(super) fn warning_if(holds: bool) -> Tone {
        if holds { Tone::Warning } else { Tone::Plain }
    }

    /// Its colour, as a terminal wants it.
    fn colour(self) -> Option<&'static str> {
        match self {
            Tone::Plain => None,
            Tone::Good => Some("\x1b[32m"),
            Tone::Warning => Some("\x1b[33m"),
            Tone::Bad => Some("\x1b[31m"),
        }
    }
}

const END_OF_COLOUR: &str = "\x1b[39m";

/// A line of the screen.
#[derive(Clone, Debug, Default)]
pub(super) struct Line(Vec<(Tone, String)>);

impl Line {
    /// Begins with plain text.
    pub(super) fn plain(text: String) -> Line {
        Line(vec![(Tone::Plain, text)])
    }

    /// Goes on with `text`.
    pub(super) fn then(mut self, tone: Tone, text: String) -> Line {
        self.0.push((tone, text));
        self
    }

    /// Letters in it.
    pub(super) fn width(&self) -> usize {
        self.0.iter().map(|(_, text)| text.chars().filter(|letter| !letter.is_control()).count()).sum()
    }

    /// Without blanks at its end.
    pub(super) fn trimmed(mut self) -> Line {
        if let Some((_, text)) = self.0.last_mut() {
            text.truncate(text.trim_end().len());
        }
        self
    }

    /// The first `width` characters. A number or word that is cut goes altogether: half a number is another one. Control
    /// characters, which could only come from a name, are left out.
    pub(super) fn render(&self, width: usize, colours: bool) -> String {
        let mut room = width;
        let mut line = String::new();
        for (tone, text) in &self.0 {
            let mut letters = text.chars().filter(|letter| !letter.is_control());
            let mut piece: String = letters.by_ref().take(room).collect();
            room -= piece.chars().count();
            if letters.next().is_some_and(|next| next != ' ')
                && let Some(space) = piece.rfind(' ')
                && space + 1 < piece.len()
            {
                piece.truncate(space + 1);
                piece.push('…');
            }
            match tone.colour().filter(|_| colours && !piece.is_empty()) {
                Some(colour) => line.extend([colour, piece.as_str(), END_OF_COLOUR]),
                None => line.push_str(&piece),
            }
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_counted_and_colours_are_not() {
        let line = Line::plain("ab".to_owned()).then(Tone::Bad, "cσd".to_owned()).then(Tone::Plain, "e".to_owned());
        assert_eq!(line.render(4, true), "ab\x1b[31mcσ\x1b[39m");
        assert_eq!(line.render(2, true), "ab");
        assert_eq!(line.render(9, false), "abcσde");
    }

    #[test]
    fn a_number_that_does_not_fit_is_left_out_and_not_shown_by_halves() {
        let line = Line::plain("gated 9, out_of_range 1234".to_owned());
        assert_eq!(line.render(26, false), "gated 9, out_of_range 1234");
        assert_eq!(line.render(24, false), "gated 9, out_of_range …");
        assert_eq!(line.render(12, false), "gated 9, …");
        assert_eq!(line.render(8, false), "gated 9,");
    }
}
