//! A view of JSON that never fails. What is absent, or is not of the type asked for, is nothing. So an odd
//! member that nobody needs does no harm.

use serde_json::Value;

/// A value of the file, or nothing.
#[derive(Clone, Copy)]
pub(super) struct Json<'a>(Option<&'a Value>);

impl<'a> Json<'a> {
    pub(super) fn new(value: &'a Value) -> Self {
        Self(Some(value))
    }

    pub(super) fn exists(self) -> bool {
        self.0.is_some()
    }

    /// Returns a member of an object.
    pub(super) fn get(self, key: &str) -> Self {
        Self(self.0.and_then(|value| value.get(key)))
    }

    pub(super) fn extension(self, name: &str) -> Self {
        self.get("extensions").get(name)
    }

    /// Returns the entries of the array `key`.
    pub(super) fn list(self, key: &str) -> impl DoubleEndedIterator<Item = Self> + ExactSizeIterator + Clone + use<'a> {
        self.get(key).array().iter().map(|value| Self(Some(value)))
    }

    /// Returns entry `index` of the array `key`.
    pub(super) fn entry(self, key: &str, index: usize) -> Self {
        Self(self.get(key).array().get(index))
    }

    /// Returns the whole numbers of the array `key`.
    pub(super) fn indices(self, key: &str) -> Vec<usize> {
        self.get(key).array().iter().filter_map(whole).collect()
    }

    /// Returns the name of entry `index` of an array, or else its number.
    pub(super) fn name_or(self, index: impl ToString) -> String {
        self.text("name").map_or_else(|| index.to_string(), str::to_owned)
    }

    /// Returns a whole number from 0, which exporters also write as 3.0.
    pub(super) fn index(self, key: &str) -> Option<usize> {
        self.get(key).0.and_then(whole)
    }

    /// Returns a number that single precision holds.
    pub(super) fn number(self, key: &str) -> Option<f32> {
        self.get(key).0.and_then(finite)
    }

    /// Returns an array of `N` numbers that single precision holds.
    pub(super) fn numbers<const N: usize>(self, key: &str) -> Option<[f32; N]> {
        let numbers: Option<Vec<f32>> = self.get(key).array().iter().map(finite).collect();
        numbers?.try_into().ok()
    }

    /// Returns an array of numbers that single precision holds; empty if one is none.
    pub(super) fn floats(self, key: &str) -> Vec<f32> {
        self.get(key).array().iter().map(finite).collect::<Option<_>>().unwrap_or_default()
    }

    pub(super) fn text(self, key: &str) -> Option<&'a str> {
        self.get(key).0.and_then(Value::as_str)
    }

    pub(super) fn texts(self, key: &str) -> impl Iterator<Item = &'a str> {
        self.get(key).array().iter().filter_map(Value::as_str)
    }

    pub(super) fn flag(self, key: &str) -> bool {
        self.get(key).0.and_then(Value::as_bool).unwrap_or(false)
    }

    fn array(self) -> &'a [Value] {
        self.0.and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }
}

fn finite(value: &Value) -> Option<f32> {
    value.as_f64().map(|number| number as f32).filter(|number| number.is_finite())
}

fn whole(value: &Value) -> Option<usize> {
    let float = || value.as_f64().filter(|x| *x >= 0.0 && x.fract() == 0.0 && *x < 9e15).map(|x| x as u64);
    value.as_u64().or_else(float).and_then(|number| usize::try_from(number).ok())
}

/// Replaces NaN and Infinity outside of strings by null.
pub(super) fn without_nan(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let (mut word, mut in_string, mut escaped) = (String::new(), false, false);
    for letter in text.chars() {
        if !in_string && (letter.is_ascii_alphabetic() || letter == '-') {
            word.push(letter);
            continue;
        }
        let number = word.trim_start_matches('-').to_ascii_lowercase();
        out += if ["nan", "inf", "infinity"].contains(&number.as_str()) { "null" } else { &word };
        word.clear();
        out.push(letter);
        in_string ^= letter == '"' && !escaped;
        escaped = in_string && letter == '\\' && !escaped;
    }
    out + &word
}

#[cfg(test)]
mod tests {
    use super::without_nan;

    #[test]
    fn numbers_that_json_lacks_become_nothing() {
        let text = r#"{"a":[NaN,-Infinity,1e-5,-2],"NaN":"a \"NaN\"","b":true}"#;
        assert_eq!(without_nan(text), r#"{"a":[null,null,1e-5,-2],"NaN":"a \"NaN\"","b":true}"#);
    }
}
