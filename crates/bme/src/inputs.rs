//! A table of inputs or outputs, one sample a row.

/// Rows of equal length in `f32`: what bases are centred on and what files hold.
///
/// A model fitted to these very values and a model read back from a file therefore predict the same bits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inputs {
    dim: usize,
    values: Vec<f32>,
}

/// Why a table cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputsError {
    /// The number of values is no multiple of the row length.
    #[error("{count} values make no rows of {dim}")]
    Ragged {
        /// How many values there are.
        count: usize,
        /// The row length.
        dim: usize,
    },
    /// A value is NaN or infinite.
    #[error("row {row}, column {column} is {value}, expected a finite number")]
    NotFinite {
        /// Which row.
        row: usize,
        /// Which column.
        column: usize,
        /// What stands there.
        value: f64,
    },
}

impl Inputs {
    /// Rows of `dim` from one run of values; each value is rounded to `f32`.
    ///
    /// # Errors
    /// When the rows do not come out even, or a value is not finite in `f32`.
    pub fn from_rows(dim: usize, values: impl IntoIterator<Item = f64>) -> Result<Self, InputsError> {
        let values: Vec<f32> = values.into_iter().map(|v| v as f32).collect();
        if dim == 0 || !values.len().is_multiple_of(dim) {
            return Err(InputsError::Ragged { count: values.len(), dim });
        }
        match values.iter().position(|v| !v.is_finite()) {
            Some(at) => {
                Err(InputsError::NotFinite { row: at / dim, column: at % dim, value: f64::from(values[at]) })
            }
            None => Ok(Self { dim, values }),
        }
    }

    /// The number of rows.
    pub fn len(&self) -> usize {
        self.values.len() / self.dim.max(1)
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The length of a row.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// Row `i`.
    pub fn row(&self, i: usize) -> &[f32] {
        &self.values[i * self.dim..(i + 1) * self.dim]
    }

    /// Row `i` in `f64`.
    pub fn row_f64(&self, i: usize) -> Vec<f64> {
        self.row(i).iter().map(|&v| f64::from(v)).collect()
    }

    /// The values, row after row.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The rows named in `rows`, in that order.
    pub fn select(&self, rows: &[usize]) -> Self {
        let values = rows.iter().flat_map(|&i| self.row(i).iter().copied()).collect();
        Self { dim: self.dim, values }
    }

    /// Appends a row.
    ///
    /// # Panics
    /// When its length is not [`Self::dim`].
    pub fn push(&mut self, row: &[f64]) {
        assert_eq!(row.len(), self.dim, "a row of {} for a table of rows of {}", row.len(), self.dim);
        self.values.extend(row.iter().map(|&v| v as f32));
    }
}
