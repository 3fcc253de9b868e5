//! Reads a TOML table strictly. Every key is asked for by name and type. Everything that is wrong is
//! collected, so that one look at a file reports it all.

use crate::{Error, terminal};
use std::{
    cell::RefCell,
    path::{Path, PathBuf},
};
use toml::{Table, Value};

/// The problems found so far in one file.
pub struct Problems {
    file: PathBuf,
    problems: RefCell<Vec<Error>>,
}

impl Problems {
    /// Makes an empty report about `file`.
    pub fn new(file: &Path) -> Self {
        Self { file: file.to_path_buf(), problems: RefCell::default() }
    }

    /// Adds a problem of the field `field` (a dotted path).
    pub fn add(&self, field: &str, problem: impl ToString, remedy: impl ToString) {
        let subject = format!("{}: {field}", self.file.display());
        self.problems.borrow_mut().push(Error::input(subject, problem, remedy));
    }

    /// Returns the folder of the file. Paths in the file are relative to it.
    pub fn folder(&self) -> &Path {
        self.file.parent().unwrap_or(Path::new(""))
    }

    /// Returns all problems, in the order found.
    pub fn into_problems(self) -> Vec<Error> {
        self.problems.into_inner()
    }
}

/// One table of the file, with its dotted name.
pub struct FieldTable<'a> {
    report: &'a Problems,
    name: String,
    table: &'a Table,
}

impl<'a> FieldTable<'a> {
    /// Opens the table called `name` (empty: the whole file). Reports keys that are not among `known`, with
    /// the nearest one.
    pub fn new(report: &'a Problems, name: &str, table: &'a Table, known: &[&str]) -> Self {
        let fields = Self { report, name: name.to_owned(), table };
        for key in table.keys().filter(|key| !known.contains(&key.as_str())) {
            fields.complain(key, "unknown key", nearest(key, known));
        }
        fields
    }

    /// Returns the dotted path of `key`.
    pub fn path(&self, key: &str) -> String {
        if self.name.is_empty() { key.to_owned() } else { format!("{}.{key}", self.name) }
    }

    /// Returns the file and the dotted path of `key`, as errors and warnings name it.
    pub fn subject(&self, key: &str) -> String {
        format!("{}: {}", self.report.file.display(), self.path(key))
    }

    /// Reports a problem that says what it is about.
    pub fn report(&self, problem: Error) {
        self.report.problems.borrow_mut().push(problem);
    }

    /// Reports a problem of `key`.
    pub fn complain(&self, key: &str, problem: impl ToString, remedy: impl ToString) {
        self.report.add(&self.path(key), problem, remedy);
    }

    /// Returns the raw value.
    pub fn value(&self, key: &str) -> Option<&'a Value> {
        self.table.get(key)
    }

    /// Says whether the key is there.
    pub fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    fn wrong_type(&self, key: &str, expected: &str, found: &Value, example: &str) {
        let beyond = |value: &Value| as_number(value).filter(|number| !is_held(*number));
        let within = found.as_array().into_iter().flatten().find_map(beyond);
        if let Some(number) = beyond(found).or(within) {
            let remedy = format!("give 0, or a number whose size is from {:e} to {:e}", HELD.start(), HELD.end());
            self.complain(key, format!("{number:e} is out of range"), remedy);
            return;
        }
        self.complain(key, format!("expected {expected}, found {}", kind(found)), format!("write {key} = {example}"));
    }

    /// Reads a number, integer or float, that single precision holds.
    pub fn number(&self, key: &str) -> Option<f64> {
        let value = self.value(key)?;
        let number = as_number(value).filter(|number| is_held(*number));
        if number.is_none() {
            self.wrong_type(key, "a finite number", value, "1.0");
        }
        number
    }

    /// Reads a finite number for which `accept` holds. `range` says in words what is accepted.
    pub fn number_in(&self, key: &str, range: &str, accept: impl Fn(f64) -> bool) -> Option<f64> {
        let number = self.number(key)?;
        if !accept(number) {
            self.complain(key, format!("{number} is out of range"), format!("give a number {range}"));
            return None;
        }
        Some(number)
    }

    /// Reads a string.
    pub fn string(&self, key: &str) -> Option<&'a str> {
        let value = self.value(key)?;
        if value.as_str().is_none() {
            self.wrong_type(key, "a string", value, "\"…\"");
        }
        value.as_str()
    }

    /// Reads one of a few words and returns its index in `words`.
    pub fn word(&self, key: &str, words: &[&str]) -> Option<usize> {
        let given = self.string(key)?;
        let found = words.iter().position(|word| *word == given);
        if found.is_none() {
            self.complain(key, format!("\"{given}\" is not known"), nearest(given, words));
        }
        found
    }

    /// Reads an array of `N` numbers that single precision holds.
    pub fn vector<const N: usize>(&self, key: &str) -> Option<[f64; N]> {
        let value = self.value(key)?;
        let held = |numbers: &Vec<f64>| numbers.iter().all(|number| is_held(*number));
        let numbers = as_numbers(value).filter(held).and_then(|numbers| numbers.try_into().ok());
        if numbers.is_none() {
            let example = format!("[{}]", ["0"; N].join(", "));
            self.wrong_type(key, &format!("an array of {N} finite numbers"), value, &example);
        }
        numbers
    }

    /// Reads an array of any number of finite numbers that single precision holds.
    pub fn numbers(&self, key: &str) -> Option<Vec<f64>> {
        let value = self.value(key)?;
        let numbers = as_numbers(value).filter(|numbers| numbers.iter().all(|number| is_held(*number)));
        if numbers.is_none() {
            self.wrong_type(key, "an array of finite numbers", value, "[0]");
        }
        numbers
    }

    /// Reads an array of numbers of any size, which are compared in double precision.
    pub fn codes(&self, key: &str) -> Option<Vec<f64>> {
        let value = self.value(key)?;
        let numbers = as_numbers(value);
        if numbers.is_none() {
            self.complain(key, format!("expected an array of finite numbers, found {}", kind(value)), "write [0]");
        }
        numbers
    }

    /// Reads an array of integers, each ≥ 0 and below 2³².
    pub fn integers(&self, key: &str) -> Option<Vec<u32>> {
        let value = self.value(key)?;
        let integers = value.as_array().and_then(|items| {
            items.iter().map(|item| item.as_integer().and_then(|i| u32::try_from(i).ok())).collect::<Option<Vec<_>>>()
        });
        if integers.is_none() {
            self.wrong_type(key, "an array of whole numbers", value, "[0, 1]");
        }
        integers
    }

    /// Reads a file path. `$NAME` and `${NAME}` come from the environment. The path is relative to the file's
    /// folder.
    pub fn file_path(&self, key: &str) -> Option<PathBuf> {
        let text = self.string(key)?;
        if text.is_empty() {
            self.complain(key, "an empty path", "name a file");
            return None;
        }
        match expand(text, |name| std::env::var(name).ok()) {
            Ok(path) => {
                let path = self.report.folder().join(path);
                if let Some(value) = text.contains('$').then(|| path.to_str()).flatten() {
                    let end = |text: &str| text.find(['%', '#']).unwrap_or(text.len());
                    terminal::hide(&value[..end(value)], &text[..end(text)]);
                    // A glTF file names others beside it.
                    let folder = |path: &str| Path::new(path).parent().and_then(Path::to_str).map(str::to_owned);
                    if let (Some(value), Some(text)) = (folder(value), folder(text).filter(|text| text.contains('$'))) {
                        terminal::hide(&value, &text);
                    }
                }
                Some(path)
            }
            Err(name) => {
                self.complain(
                    key,
                    format!("\"{text}\" uses the environment variable {name}, which is not set"),
                    format!("set it, as in: export {name}=…"),
                );
                None
            }
        }
    }

    /// Opens the table `key`, if it is there.
    pub fn table(&self, key: &str, known: &[&str]) -> Option<FieldTable<'a>> {
        match self.value(key)? {
            Value::Table(table) => Some(FieldTable::new(self.report, &self.path(key), table, known)),
            other => {
                self.complain(key, format!("expected a table, found {}", kind(other)), format!("write [{key}]"));
                None
            }
        }
    }

    /// Opens the array of tables `key`, empty if absent. Entries are called `key[0]`, `key[1]` and so on.
    pub fn tables(&self, key: &str, known: &[&str]) -> Vec<FieldTable<'a>> {
        let entries = match self.value(key) {
            None => return Vec::new(),
            Some(Value::Array(entries)) => entries,
            Some(other) => {
                let remedy = format!("write [[{key}]], once for each");
                self.complain(key, format!("expected an array of tables, found {}", kind(other)), remedy);
                return Vec::new();
            }
        };
        let mut tables = Vec::new();
        for (index, entry) in entries.iter().enumerate() {
            let name = format!("{key}[{index}]");
            match entry {
                Value::Table(table) => tables.push(FieldTable::new(self.report, &self.path(&name), table, known)),
                other => self.complain(&name, format!("expected a table, found {}", kind(other)), "write { … }"),
            }
        }
        tables
    }
}

/// The sizes of numbers that the renderer computes with: squares and cubes of them are finite, and none
/// becomes 0.
const HELD: std::ops::RangeInclusive<f64> = 1e-30..=1e12;

fn is_held(number: f64) -> bool {
    number == 0.0 || HELD.contains(&number.abs())
}

/// Asks "did you mean …", or lists all known words if none is near.
pub fn nearest(given: &str, known: &[&str]) -> String {
    let near = known
        .iter()
        .map(|word| (strsim::damerau_levenshtein(&given.to_lowercase(), word), *word))
        .min()
        .filter(|(distance, word)| *distance <= (word.len().max(given.len()) / 2).max(1));
    match near {
        Some((_, word)) => format!("did you mean `{word}`?"),
        None => format!("known here: {}", known.join(", ")),
    }
}

fn kind(value: &Value) -> String {
    match value {
        Value::String(_) => "a string".into(),
        Value::Integer(_) => "an integer".into(),
        Value::Float(number) if number.is_finite() => "a number".into(),
        Value::Float(number) => number.to_string(),
        Value::Boolean(_) => "a boolean".into(),
        Value::Datetime(_) => "a date".into(),
        Value::Array(items) => format!("an array of {}", items.len()),
        Value::Table(_) => "a table".into(),
    }
}

/// Returns a finite number, integer or float.
pub fn as_number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(integer) => Some(*integer as f64),
        Value::Float(float) if float.is_finite() => Some(*float),
        _ => None,
    }
}

fn as_numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(as_number).collect()
}

/// Replaces `$NAME` and `${NAME}`. `$$` is a dollar sign.
///
/// # Errors
/// Fails with the name that `lookup` does not know.
pub fn expand(text: &str, lookup: impl Fn(&str) -> Option<String>) -> Result<String, String> {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find('$') {
        out += &rest[..at];
        rest = &rest[at + 1..];
        if let Some(after) = rest.strip_prefix('$') {
            out.push('$');
            rest = after;
            continue;
        }
        let (name, after) = match rest.strip_prefix('{').and_then(|inner| inner.split_once('}')) {
            Some((name, after)) => (name, after),
            None => {
                let end = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len());
                rest.split_at(end)
            }
        };
        if name.is_empty() {
            out.push('$');
        } else {
            out += &lookup(name).ok_or_else(|| name.to_owned())?;
        }
        rest = after;
    }
    out += rest;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environment_names_are_expanded() {
        let lookup = |name: &str| (name == "A_1").then(|| "x".to_owned());
        assert_eq!(expand("$A_1/b", lookup), Ok("x/b".into()));
        assert_eq!(expand("${A_1}b/$$", lookup), Ok("xb/$".into()));
        assert_eq!(expand("c/$", lookup), Ok("c/$".into()));
        assert_eq!(expand("$B/b", lookup), Err("B".into()));
    }

    #[test]
    fn the_nearest_word_is_named() {
        assert_eq!(nearest("colour", &["color", "depth"]), "did you mean `color`?");
        assert_eq!(nearest("zzzzzz", &["color", "depth"]), "known here: color, depth");
    }
}
