//! What the tokens of a source say: its items, its imports, the paths in its code.

use std::collections::{BTreeMap, BTreeSet};

use proc_macro2::{Delimiter, TokenStream, TokenTree};

pub fn is_word(token: &TokenTree, word: &str) -> bool {
    matches!(token, TokenTree::Ident(ident) if *ident == word)
}

pub fn is_sign(token: &TokenTree, sign: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == sign)
}

fn is_body(token: &TokenTree) -> bool {
    matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace)
}

/// What is compiled without tests: items behind `#[cfg(test)]` and its like are left out.
pub fn without_tests(tokens: Vec<TokenTree>) -> Vec<TokenTree> {
    let mut kept: Vec<TokenTree> = Vec::new();
    let mut tokens = tokens.into_iter();
    while let Some(token) = tokens.next() {
        let of_tests = |text: String| {
            let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
            ["cfg(test)", "cfg(all(test", "cfg(any(test"].iter().any(|begin| text.starts_with(begin))
        };
        match token {
            TokenTree::Group(group)
                if kept.last().is_some_and(|last| is_sign(last, '#'))
                    && group.delimiter() == Delimiter::Bracket
                    && of_tests(group.stream().to_string()) =>
            {
                kept.pop();
                // To the end of the item.
                for skipped in tokens.by_ref() {
                    if is_body(&skipped) || is_sign(&skipped, ';') {
                        break;
                    }
                }
            }
            token => kept.push(token),
        }
    }
    kept
}

/// Names of what a file defines outside of blocks.
pub fn defined(tokens: &[TokenTree]) -> BTreeSet<String> {
    let kinds = ["struct", "enum", "union", "trait", "type", "fn", "const", "static", "macro_rules"];
    let mut found = BTreeSet::new();
    for (k, token) in tokens.iter().enumerate() {
        if kinds.iter().any(|kind| is_word(token, kind)) {
            let name = tokens[k + 1..].iter().find(|token| !is_sign(token, '!'));
            found.extend(name.map(ToString::to_string));
        }
    }
    found
}

/// Types of `impl` blocks that are of no trait, as paths.
pub fn impls(tokens: &[TokenTree]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for (k, token) in tokens.iter().enumerate() {
        // Elsewhere the word stands in a type: `-> impl Fn()`.
        let begins_item = k == 0
            || is_body(&tokens[k - 1])
            || is_sign(&tokens[k - 1], ';')
            || is_word(&tokens[k - 1], "unsafe")
            || matches!(&tokens[k - 1], TokenTree::Group(group) if group.delimiter() == Delimiter::Bracket);
        if !is_word(token, "impl") || !begins_item {
            continue;
        }
        let header: Vec<TokenTree> =
            tokens[k + 1..].iter().take_while(|token| !is_body(token)).cloned().collect();
        let header = header.split(|token| is_word(token, "where")).next().unwrap_or_default();
        let of_type = &header[generics(header)..];
        if !of_type.iter().any(|token| is_word(token, "for")) {
            let begin = usize::from(of_type.first().is_some_and(|token| is_word(token, "dyn")));
            found.push(path_at(of_type, begin).0);
        }
    }
    found
}

/// How many tokens the generic parameters at the beginning take: `<'a, T: Fn() -> f64>`.
fn generics(tokens: &[TokenTree]) -> usize {
    let (mut depth, mut before) = (0, None);
    for (k, token) in tokens.iter().enumerate() {
        let is_arrow = before.is_some_and(|before| is_sign(before, '-'));
        depth += i32::from(is_sign(token, '<')) - i32::from(is_sign(token, '>') && !is_arrow);
        if depth == 0 {
            return if k == 0 { 0 } else { k + 1 };
        }
        before = Some(token);
    }
    tokens.len()
}

/// What the `use` of a file, those in blocks apart, bring in: name -> path. Of `a::*` the name is `*a`.
pub fn uses(tokens: &[TokenTree]) -> BTreeMap<String, Vec<String>> {
    let mut found = BTreeMap::new();
    for (k, _) in tokens.iter().enumerate().filter(|(_, token)| is_word(token, "use")) {
        let end = tokens[k..].iter().position(|token| is_sign(token, ';')).map_or(tokens.len(), |n| k + n);
        for Import { path, name } in imports(&tokens[k + 1..end]) {
            found.insert(name, path);
        }
    }
    found
}

struct Import {
    path: Vec<String>,
    name: String,
}

/// One part of a `use`, taken apart.
fn imports(part: &[TokenTree]) -> Vec<Import> {
    let (path, at) = path_at(part, 0);
    match part.get(at) {
        Some(TokenTree::Group(group)) => {
            let inner: Vec<TokenTree> = group.stream().into_iter().collect();
            let parts = inner.split(|token| is_sign(token, ',')).filter(|part| !part.is_empty());
            let joined = parts.flat_map(imports).map(|Import { path: end, name }| {
                // `a::{self}` is `a`.
                let end = if end == ["self"] { Vec::new() } else { end };
                let name = if name == "self" { path.last().cloned().unwrap_or_default() } else { name };
                Import { path: [path.clone(), end].concat(), name }
            });
            joined.collect()
        }
        Some(star) if is_sign(star, '*') => {
            let name = format!("*{}", path.join("::"));
            vec![Import { path, name }]
        }
        Some(word) if is_word(word, "as") => {
            let name = part.get(at + 1).map(ToString::to_string).unwrap_or_default();
            vec![Import { path, name }]
        }
        _ => {
            let name = path.last().cloned().unwrap_or_default();
            vec![Import { path, name }]
        }
    }
}

/// Paths that begin with `crate`, `super`, `self` or a word that begins one; groups of a `use` are taken apart.
pub fn find_paths(
    tokens: &[TokenTree],
    begins: &dyn Fn(&str) -> bool,
    found: &mut Vec<(usize, Vec<String>)>,
) {
    let mut at = 0;
    while at < tokens.len() {
        if let TokenTree::Group(group) = &tokens[at] {
            find_paths(&without_tests(group.stream().into_iter().collect()), begins, found);
        }
        let TokenTree::Ident(first) = &tokens[at] else {
            at += 1;
            continue;
        };
        let after_colons = at >= 2 && is_sign(&tokens[at - 1], ':') && is_sign(&tokens[at - 2], ':');
        let word = first.to_string();
        let line = first.span().start().line;
        if after_colons || !(["crate", "super", "self"].contains(&word.as_str()) || begins(&word)) {
            at += 1;
            continue;
        }
        let (path, next) = path_at(tokens, at);
        at = next;
        match tokens.get(at) {
            // `use a::b::{...}`
            Some(TokenTree::Group(group)) if is_sign(&tokens[at - 1], ':') => {
                for inner in alternatives(group.stream()) {
                    found.push((line, [path.clone(), inner].concat()));
                }
                at += 1;
            }
            _ if path.len() > 1 => found.push((line, path)),
            _ => {}
        }
    }
}

/// The words of a path from here on, and where it ends.
fn path_at(tokens: &[TokenTree], mut at: usize) -> (Vec<String>, usize) {
    let mut path = Vec::new();
    while let Some(TokenTree::Ident(word)) = tokens.get(at) {
        path.push(word.to_string());
        let follows = |k: usize| tokens.get(at + k).is_some_and(|token| is_sign(token, ':'));
        if !(follows(1) && follows(2)) {
            return (path, at + 1);
        }
        at += 3;
    }
    (path, at)
}

/// What stands between the braces of a `use`, taken apart.
fn alternatives(stream: TokenStream) -> Vec<Vec<String>> {
    let tokens: Vec<TokenTree> = stream.into_iter().collect();
    let mut found = Vec::new();
    for part in tokens.split(|token| is_sign(token, ',')).filter(|part| !part.is_empty()) {
        found.extend(imports(part).into_iter().map(|import| import.path));
    }
    found
}
