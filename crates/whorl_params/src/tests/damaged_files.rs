//! Damaged files give errors, never a panic, and an edit of them is right or refused.

use crate::{ParameterTree, Value, set_in_text};

/// Numbers from a seed (SplitMix64).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % limit as u64) as usize
    }
}

const TEXT: &str = "\
# head
/**:
  ros__parameters: {formation: {platforms: [whorl_1, \"b\"]}}
/whorl_1/estimator:
  ros__parameters:
    gain: 1.5   # [1] \u{b5}
    mode: 'it''s'
    list:
      - 1
      - 2
    text: |
      several
      lines
    g: {a: true, b: .5}
";

#[test]
fn damaged_files_never_panic() {
    const PIECES: [&str; 24] = [
        ":", ": ", "- ", "{", "}", "[", "]", ",", "\"", "'", "#", "&a ", "*a", "!!t ", "|", ">", "\t", "\n",
        "\r\n", "  ", "---\n", "\u{feff}", "\u{fc}", "\0",
    ];
    let rounds = std::env::var("WHORL_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(1000);
    let mut numbers = Numbers(7);
    let (mut loaded, mut edited) = (0, 0);
    for _ in 0..rounds {
        let mut characters: Vec<char> = TEXT.chars().collect();
        for _ in 0..=numbers.below(4) {
            let at = numbers.below(characters.len());
            let end = (at + numbers.below(6)).min(characters.len());
            let piece = PIECES[numbers.below(PIECES.len())];
            if numbers.below(2) == 0 {
                characters.splice(at..end, piece.chars());
            } else {
                characters.splice(at..at, piece.chars());
            }
        }
        let text: String = characters.into_iter().collect();
        let Ok(tree) = ParameterTree::from_texts(&[("p", &text)], &[]) else { continue };
        loaded += 1;
        let before = tree.for_node("/whorl_1/estimator");
        let key = ["gain", "mode", "list", "text", "g.a", "g.c", "new.key"][numbers.below(7)];
        let Ok(after) = set_in_text("p", &text, "/whorl_1/estimator", key, &Value::Double(2.5), Some("c"))
        else {
            continue;
        };
        edited += 1;
        let after = ParameterTree::from_texts(&[("p", &after)], &[]).unwrap().for_node("/whorl_1/estimator");
        assert_eq!(after.get(key).unwrap().value, Value::Double(2.5), "{text}");
        for entry in before.iter().filter(|entry| entry.key != key) {
            assert_eq!(after.get(&entry.key).unwrap().value, entry.value, "{key} in {text}");
        }
    }
    assert!(
        loaded > rounds / 50 && edited > loaded / 2,
        "{loaded} loaded, {edited} edited: the test has no bite"
    );
}

#[test]
fn files_of_very_many_keys_values_and_errors_are_refused_at_once() {
    let refused = |text: &str| {
        let errors = ParameterTree::from_texts(&[("many.yaml", text)], &[]).unwrap_err();
        assert!(errors.len() <= 201, "{} errors", errors.len());
        let shown = errors.to_string();
        assert!(shown.len() < 20_000, "{} bytes are shown", shown.len());
        shown
    };
    let head = "/coordinator:\n  ros__parameters:\n";
    let keys = |key: &dyn Fn(u32) -> String| {
        head.to_owned() + &(0..100_000).map(|i| format!("    {}: 1\n", key(i))).collect::<String>()
    };
    assert!(refused(&keys(&|i| format!("k{i}"))).contains("more than 10000 keys"));
    let twice = refused(&keys(&|_| "k".to_owned()));
    assert!(twice.contains("the key stands here and on line 3") && twice.contains("more errors"), "{twice}");
    assert!(
        refused(&format!("{head}    a: [{}]\n", "1,".repeat(600_000))).contains("more than 500000 values")
    );
}
