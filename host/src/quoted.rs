//! Somebody else's text in messages.

use std::fmt::Display;

/// Most characters of somebody else's text that a message quotes.
pub const QUOTED: usize = 200;

/// Text of a file or an argument as messages quote it: long text without its middle, and nothing in it that moves a
/// terminal's cursor.
pub fn quoted(text: impl Display) -> String {
    let text: Vec<char> = text
        .to_string()
        .chars()
        .map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c })
        .collect();
    let head = if text.len() > QUOTED { QUOTED * 2 / 3 } else { text.len() };
    let tail = if text.len() > QUOTED { text.len() - (QUOTED - head - 1) } else { text.len() };
    let gap = if head < tail { "…" } else { "" };
    text[..head].iter().copied().chain(gap.chars()).chain(text[tail..].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_quotes_lose_their_middle() {
        assert_eq!(quoted("mesh.obj"), "mesh.obj");
        let whole = "a".repeat(QUOTED);
        assert_eq!(quoted(&whole), whole);
        let long = quoted(format!("/first/{}/last", "ä".repeat(1_000_000)));
        assert_eq!(long.chars().count(), QUOTED);
        assert!(long.starts_with("/first/") && long.contains('…') && long.ends_with("/last"), "{long}");
        assert_eq!(quoted("a\nb\u{1b}[2J"), "a\u{fffd}b\u{fffd}[2J");
    }
}
