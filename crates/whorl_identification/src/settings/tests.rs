use super::*;

#[test]
fn there_are_few_and_each_says_what_it_is_and_where_it_is_from() {
    let listed = Settings::default().listed();
    assert!(listed.len() <= 40, "{}", listed.len());
    for setting in &listed {
        assert!(setting.doc.contains('['), "{}: no unit", setting.name);
        let sources = ["Derived", "Measured", "Assumption", "assumption", "Convention"];
        assert!(sources.iter().any(|word| setting.doc.contains(word)), "{}: no source", setting.name);
    }
}

#[test]
fn the_table_of_the_method_is_that_of_the_settings() {
    let row = |of: &Setting| format!("| `{}` | {} | {} |", of.name, of.value, doc_of(of.name));
    let rows: Vec<String> = Settings::default().listed().iter().map(row).collect();
    let method = include_str!("../../METHOD.md");
    let section = method.split("\n## ").find(|part| part.starts_with("Settings\n")).unwrap();
    let written: Vec<&str> = section.lines().filter(|line| line.starts_with("| `")).collect();
    assert_eq!(written, rows);
}

#[test]
fn a_setting_is_changed_by_its_name_and_what_it_cannot_be_is_refused() {
    let mut settings = Settings::default();
    settings.set("sure", 0.9).unwrap();
    let changed = Settings { sure: 0.9, ..Settings::default() };
    assert_eq!(settings, changed);
    for (name, value, part) in [
        ("sure", 1.5, "between 0 and 1"),
        ("at_work_s", 0.0, "> 0"),
        ("at_work_s", f64::NAN, "> 0"),
        ("shure", 0.9, "allowed: present, unmodelled"),
    ] {
        let refused = settings.set(name, value).unwrap_err();
        assert!(refused.contains(part), "{name} {value}: {refused}");
    }
    assert_eq!(settings, changed);
}
