//! Typed access to the fields of TOML, JSON and YAML files, with errors that name field, value and expectation.

/// The value of a field, whatever the format it was written in.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Number(f64),
    Text(String),
    List(Vec<Value>),
    Table(Vec<(String, Value)>),
    /// Booleans, dates, nulls: nothing that a field here can be.
    Other,
}

/// A value and the path to it, such as `rotation[1][2]`.
#[derive(Clone, Debug)]
pub(crate) struct Field<'a> {
    path: String,
    value: &'a Value,
}

/// Why a field cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum FieldError {
    /// A required field that is not there.
    #[error("`{field}` is missing")]
    Missing { field: String },
    /// A value of the wrong kind.
    #[error("`{field}` is {value}, expected {expected}")]
    Value { field: String, value: String, expected: &'static str },
    /// A list of the wrong length.
    #[error("`{field}` has {count} values, expected {expected}")]
    Count { field: String, count: usize, expected: usize },
}

impl<'a> Field<'a> {
    /// The file as a whole.
    pub(crate) fn root(value: &'a Value) -> Self {
        Self { path: String::new(), value }
    }

    /// The field that goes by one of `names`, the first of which is its name in messages.
    pub(crate) fn find(&self, names: &[&str]) -> Option<Field<'a>> {
        let Value::Table(entries) = self.value else {
            return None;
        };
        let (name, value) = names.iter().find_map(|name| entries.iter().find(|(key, _)| key == name))?;
        let path = if self.path.is_empty() { name.clone() } else { format!("{}.{name}", self.path) };
        Some(Field { path, value })
    }

    /// As [`Field::find`], for a field that must be there.
    pub(crate) fn require(&self, names: &[&str]) -> Result<Field<'a>, FieldError> {
        self.find(names).ok_or_else(|| FieldError::Missing { field: names[0].to_owned() })
    }

    pub(crate) fn items(&self) -> Result<Vec<Field<'a>>, FieldError> {
        let Value::List(items) = self.value else {
            return Err(self.unexpected("a list"));
        };
        let item = |(index, value)| Field { path: format!("{}[{index}]", self.path), value };
        Ok(items.iter().enumerate().map(item).collect())
    }

    pub(crate) fn number(&self) -> Result<f64, FieldError> {
        match self.value {
            Value::Number(number) if number.is_finite() => Ok(*number),
            _ => Err(self.unexpected("a finite number")),
        }
    }

    pub(crate) fn pixels(&self) -> Result<u32, FieldError> {
        match self.value {
            Value::Number(number) if number.fract() == 0.0 && (1.0..=65536.0).contains(number) => {
                Ok(*number as u32)
            }
            _ => Err(self.unexpected("a whole number of pixels from 1 to 65536")),
        }
    }

    pub(crate) fn positive_number(&self) -> Result<f64, FieldError> {
        let number = self.number()?;
        if number > 0.0 { Ok(number) } else { Err(self.unexpected("a number above 0")) }
    }

    pub(crate) fn text(&self) -> Result<&'a str, FieldError> {
        match self.value {
            Value::Text(text) => Ok(text),
            _ => Err(self.unexpected("a text")),
        }
    }

    /// All numbers of a list, of a list of rows, or of the `data` of an OpenCV matrix, row by row.
    pub(crate) fn flat_numbers(&self) -> Result<Vec<f64>, FieldError> {
        if let Some(data) = self.find(&["data"]) {
            return data.flat_numbers();
        }
        let mut numbers = Vec::new();
        for item in self.items()? {
            match item.value {
                Value::List(_) => numbers.extend(item.flat_numbers()?),
                _ => numbers.push(item.number()?),
            }
        }
        Ok(numbers)
    }

    /// As [`Field::flat_numbers`], for `N` of them.
    pub(crate) fn numbers<const N: usize>(&self) -> Result<[f64; N], FieldError> {
        let numbers = self.flat_numbers()?;
        <[f64; N]>::try_from(numbers.as_slice()).map_err(|_| FieldError::Count {
            field: self.path.clone(),
            count: numbers.len(),
            expected: N,
        })
    }

    pub(crate) fn unexpected(&self, expected: &'static str) -> FieldError {
        let value = match self.value {
            Value::Number(number) => number.to_string(),
            Value::Text(text) => format!("\"{text}\""),
            Value::List(_) => "a list".to_owned(),
            Value::Table(_) => "a table".to_owned(),
            Value::Other => "neither number nor text".to_owned(),
        };
        FieldError::Value { field: self.path.clone(), value, expected }
    }
}

impl From<toml::Value> for Value {
    fn from(value: toml::Value) -> Self {
        match value {
            toml::Value::Float(number) => Self::Number(number),
            toml::Value::Integer(number) => Self::Number(number as f64),
            toml::Value::String(text) => Self::Text(text),
            toml::Value::Array(items) => Self::List(items.into_iter().map(Self::from).collect()),
            toml::Value::Table(table) => Self::Table(table.into_iter().map(|(k, v)| (k, v.into())).collect()),
            toml::Value::Boolean(_) | toml::Value::Datetime(_) => Self::Other,
        }
    }
}

impl From<serde_json::Value> for Value {
    fn from(value: serde_json::Value) -> Self {
        match value {
            serde_json::Value::Number(number) => Self::Number(number.as_f64().unwrap_or(f64::NAN)),
            serde_json::Value::String(text) => Self::Text(text),
            serde_json::Value::Array(items) => Self::List(items.into_iter().map(Self::from).collect()),
            serde_json::Value::Object(table) => {
                Self::Table(table.into_iter().map(|(k, v)| (k, v.into())).collect())
            }
            serde_json::Value::Bool(_) | serde_json::Value::Null => Self::Other,
        }
    }
}

impl From<yaml_rust2::Yaml> for Value {
    fn from(value: yaml_rust2::Yaml) -> Self {
        use yaml_rust2::Yaml;
        match value {
            Yaml::Real(text) => Self::from_word(&text),
            Yaml::Integer(number) => Self::Number(number as f64),
            Yaml::String(text) => Self::from_word(&text),
            Yaml::Array(items) => Self::List(items.into_iter().map(Self::from).collect()),
            Yaml::Hash(table) => Self::Table(
                table.into_iter().filter_map(|(k, v)| Some((k.as_str()?.to_owned(), v.into()))).collect(),
            ),
            Yaml::Boolean(_) | Yaml::Null | Yaml::BadValue | Yaml::Alias(_) => Self::Other,
        }
    }
}

impl Value {
    /// A number where `word` is one (YAML's `.nan` and `.inf` included), else a text.
    pub(crate) fn from_word(word: &str) -> Self {
        let plain = word.to_ascii_lowercase().replace(".nan", "nan").replace(".inf", "inf");
        plain.parse().map_or_else(|_| Self::Text(word.to_owned()), Self::Number)
    }
}
