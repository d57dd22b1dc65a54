//! Licence expressions as manifests write them: `(MIT OR Apache-2.0) AND Unicode-3.0`.

use std::iter::Peekable;
use std::vec::IntoIter;

use anyhow::{Result, bail, ensure};

/// Whether `expression` can be met with the licences of `allowed` alone.
///
/// Understands `AND`, `OR`, `WITH`, parentheses, and the slash that old manifests use for `OR`.
pub fn is_met(expression: &str, allowed: &[String]) -> Result<bool> {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<String> = spaced.split_whitespace().map(str::to_owned).collect();
    let mut parser = Parser { words: words.into_iter().peekable(), allowed };
    let met = parser.any_of()?;
    ensure!(parser.words.next().is_none(), "`{expression}`: words after the end of the expression");
    Ok(met)
}

struct Parser<'a> {
    words: Peekable<IntoIter<String>>,
    allowed: &'a [String],
}

impl Parser<'_> {
    fn any_of(&mut self) -> Result<bool> {
        let mut met = self.all_of()?;
        while self.words.next_if_eq("OR").is_some() {
            met |= self.all_of()?;
        }
        Ok(met)
    }

    fn all_of(&mut self) -> Result<bool> {
        let mut met = self.one()?;
        while self.words.next_if_eq("AND").is_some() {
            met &= self.one()?;
        }
        Ok(met)
    }

    fn one(&mut self) -> Result<bool> {
        match self.words.next() {
            Some(open) if open == "(" => {
                let met = self.any_of()?;
                ensure!(self.words.next().as_deref() == Some(")"), "a parenthesis is not closed");
                Ok(met)
            }
            Some(mut licence) if !["AND", "OR", "WITH", ")"].contains(&licence.as_str()) => {
                if self.words.next_if_eq("WITH").is_some() {
                    let Some(exception) = self.words.next() else { bail!("`WITH` names no exception") };
                    licence = format!("{licence} WITH {exception}");
                }
                Ok(self.allowed.contains(&licence))
            }
            Some(word) => bail!("`{word}` where a licence was expected"),
            None => bail!("the expression ends where a licence was expected"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::is_met;

    fn met(expression: &str) -> bool {
        let allowed = ["MIT", "Apache-2.0", "Apache-2.0 WITH LLVM-exception"].map(str::to_owned);
        is_met(expression, &allowed).expect("the expression can be read")
    }

    #[test]
    fn one_allowed_choice_is_enough() {
        assert!(met("MIT") && met("MIT OR GPL-3.0") && met("GPL-3.0 OR MIT") && met("GPL-3.0/MIT"));
        assert!(!met("GPL-3.0") && !met("GPL-3.0 OR LGPL-2.1"));
    }

    #[test]
    fn all_parts_of_a_conjunction_count() {
        assert!(met("MIT AND Apache-2.0"));
        assert!(!met("(MIT OR Apache-2.0) AND Unicode-3.0"));
    }

    #[test]
    fn and_binds_tighter_than_or() {
        assert!(met("MIT OR GPL-3.0 AND GPL-2.0"));
        assert!(!met("(MIT OR GPL-3.0) AND GPL-2.0"));
    }

    #[test]
    fn an_exception_belongs_to_its_licence() {
        assert!(met("Apache-2.0 WITH LLVM-exception"));
        assert!(!met("MIT WITH LLVM-exception"));
    }

    #[test]
    fn nonsense_is_an_error() {
        for expression in ["", "MIT OR", "(MIT", "MIT)", "MIT MIT", "AND MIT", "MIT WITH"] {
            assert!(is_met(expression, &[]).is_err(), "`{expression}` was understood");
        }
    }
}
