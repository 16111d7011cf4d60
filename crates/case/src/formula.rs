//! Formulas in a scene: arithmetic of named variables, as `1.5*(1 - y^2)`.
//!
//! Usual precedence: `^` first and from the right, then a sign, then `*` and `/`, then `+` and `-`, so that `-y^2` is
//! `-(y^2)`. A formula is compiled once into postfix order and evaluated without allocation.

use std::fmt;

type Function = fn(f64) -> f64;
type Pair = fn(f64, f64) -> f64;

/// Names of the functions of one number.
const FUNCTIONS: [(&str, Function); 8] = [
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("exp", f64::exp),
    ("log", f64::ln),
    ("sqrt", f64::sqrt),
    ("abs", f64::abs),
    ("tanh", f64::tanh),
];
/// Names of the functions of two numbers.
const PAIRS: [(&str, Pair); 2] = [("min", f64::min), ("max", f64::max)];
/// Intermediate values of a formula at most.
const STACK: usize = 32;
/// Characters of a formula at most.
const LENGTH: usize = 400;

/// A formula of named variables.
///
/// # Examples
///
/// ```
/// let profile = case::Formula::parse("1.5*(1 - y^2)", &["x", "y", "z"])?;
/// assert_eq!(profile.at(&[0.0, 0.5, 0.0]), 1.125);
/// assert!(case::Formula::parse("1.5*(1 - r^2)", &["x", "y", "z"]).is_err());
/// # Ok::<(), case::FormulaError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Formula {
    postfix: Vec<Op>,
}

/// Why a text is not a formula.
#[derive(Clone, Debug, PartialEq)]
pub struct FormulaError {
    /// The formula.
    pub text: String,
    /// Character at which it ends to be one, from 1.
    pub column: usize,
    /// What is wrong there.
    pub what: String,
}

impl fmt::Display for FormulaError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` is not a formula: {} at character {}", self.text, self.what, self.column)
    }
}

impl std::error::Error for FormulaError {}

#[derive(Clone, Copy, Debug)]
enum Op {
    Number(f64),
    Variable(usize),
    Negative,
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Function(Function),
    Pair(Pair),
}

impl Formula {
    /// Compiles `text`, a formula of `variables`.
    ///
    /// # Errors
    /// The text is not a formula, or has other names in it.
    pub fn parse(text: &str, variables: &[&str]) -> Result<Self, FormulaError> {
        let mut parser = Parser { text, at: 0, variables, postfix: Vec::new(), depth: 0 };
        if text.len() > LENGTH {
            return Err(
                parser.error(format!("a formula has at most {LENGTH} characters, not {}", text.len()))
            );
        }
        parser.sum()?;
        match parser.peek() {
            None => Ok(Self { postfix: parser.postfix }),
            Some(c) => Err(parser.error(format!("an operator is missing before `{c}`"))),
        }
    }

    /// Its value where the variables have `values`, in the order in which they were named.
    pub fn at(&self, values: &[f64]) -> f64 {
        let mut stack = [0.0; STACK];
        let mut n = 0;
        for op in &self.postfix {
            match *op {
                Op::Number(_) | Op::Variable(_) => n += 1,
                Op::Negative | Op::Function(_) => {}
                _ => n -= 1,
            }
            // The parser has counted the values: there are two where an operator takes two.
            let (a, b) = (stack[n - 1], stack.get(n).copied().unwrap_or(f64::NAN));
            stack[n - 1] = match *op {
                Op::Number(x) => x,
                Op::Variable(k) => values.get(k).copied().unwrap_or(f64::NAN),
                Op::Negative => -a,
                Op::Function(f) => f(a),
                Op::Add => a + b,
                Op::Subtract => a - b,
                Op::Multiply => a * b,
                Op::Divide => a / b,
                Op::Power => a.powf(b),
                Op::Pair(f) => f(a, b),
            };
        }
        stack[0]
    }
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    variables: &'a [&'a str],
    postfix: Vec<Op>,
    depth: usize,
}

impl Parser<'_> {
    fn error(&self, what: impl Into<String>) -> FormulaError {
        let column = self.text[..self.at.min(self.text.len())].chars().count() + 1;
        FormulaError { text: self.text.into(), column, what: what.into() }
    }

    /// The next character that is not a space.
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at = self.text.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    fn take(&mut self, wanted: char) -> bool {
        let found = self.peek() == Some(wanted);
        self.at += usize::from(found) * wanted.len_utf8();
        found
    }

    fn push(&mut self, op: Op) -> Result<(), FormulaError> {
        match op {
            Op::Number(_) | Op::Variable(_) => self.depth += 1,
            Op::Negative | Op::Function(_) => {}
            _ => self.depth -= 1,
        }
        self.postfix.push(op);
        if self.depth > STACK {
            return Err(self.error(format!("more than {STACK} nested values")));
        }
        Ok(())
    }

    fn sum(&mut self) -> Result<(), FormulaError> {
        self.product()?;
        loop {
            let op = match self.peek() {
                Some('+') => Op::Add,
                Some('-') => Op::Subtract,
                _ => return Ok(()),
            };
            self.at += 1;
            self.product()?;
            self.push(op)?;
        }
    }

    fn product(&mut self) -> Result<(), FormulaError> {
        self.signed()?;
        loop {
            let op = match self.peek() {
                Some('*') => Op::Multiply,
                Some('/') => Op::Divide,
                _ => return Ok(()),
            };
            self.at += 1;
            self.signed()?;
            self.push(op)?;
        }
    }

    fn signed(&mut self) -> Result<(), FormulaError> {
        if self.take('-') {
            self.signed()?;
            return self.push(Op::Negative);
        }
        if self.take('+') {
            return self.signed();
        }
        self.single()?;
        if self.take('^') {
            self.signed()?;
            self.push(Op::Power)?;
        }
        Ok(())
    }

    fn single(&mut self) -> Result<(), FormulaError> {
        match self.peek() {
            Some('(') => {
                self.at += 1;
                self.sum()?;
                self.close()
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_ascii_alphabetic() => self.name(),
            Some(c) => Err(self.error(format!("a number or a name is missing before `{c}`"))),
            None => Err(self.error("a number or a name is missing")),
        }
    }

    fn close(&mut self) -> Result<(), FormulaError> {
        if self.take(')') { Ok(()) } else { Err(self.error("`)` is missing")) }
    }

    /// The longest run of characters from here that `belongs` accepts, given each with the one before it.
    fn word(&mut self, belongs: impl Fn(char, char) -> bool) -> String {
        let mut before = ' ';
        let rest = &self.text[self.at..];
        let end = rest.find(|c| !belongs(std::mem::replace(&mut before, c), c)).unwrap_or(rest.len());
        self.at += end;
        rest[..end].into()
    }

    fn number(&mut self) -> Result<(), FormulaError> {
        let start = self.at;
        let word = self.word(|before, c| {
            c.is_ascii_digit() || ".eE".contains(c) || ("+-".contains(c) && "eE".contains(before))
        });
        let value = word.parse::<f64>().ok().filter(|x| x.is_finite());
        let Some(value) = value else {
            self.at = start;
            return Err(self.error(format!("`{word}` is not a number")));
        };
        self.push(Op::Number(value))
    }

    fn name(&mut self) -> Result<(), FormulaError> {
        let start = self.at;
        let word = self.word(|_, c| c.is_ascii_alphanumeric() || c == '_');
        if let Some(k) = self.variables.iter().position(|v| *v == word) {
            return self.push(Op::Variable(k));
        }
        if word == "pi" {
            return self.push(Op::Number(std::f64::consts::PI));
        }
        let function = FUNCTIONS.iter().find(|(n, _)| *n == word).map(|(_, f)| Op::Function(*f));
        let pair = PAIRS.iter().find(|(n, _)| *n == word).map(|(_, f)| Op::Pair(*f));
        let Some(op) = function.or(pair) else {
            self.at = start;
            let functions = FUNCTIONS.iter().map(|f| f.0).chain(PAIRS.iter().map(|f| f.0));
            let known: Vec<&str> = self.variables.iter().copied().chain(["pi"]).chain(functions).collect();
            return Err(self.error(format!("unknown name `{word}` (known: {})", known.join(", "))));
        };
        if !self.take('(') {
            return Err(self.error(format!("`(` is missing after `{word}`")));
        }
        self.sum()?;
        if pair.is_some() {
            if !self.take(',') {
                return Err(self.error(format!("`{word}` needs two numbers: `,` is missing")));
            }
            self.sum()?;
        }
        self.push(op)?;
        self.close()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> f64 {
        Formula::parse(text, &["x", "t"]).unwrap_or_else(|e| panic!("{e}")).at(&[3.0, 0.25])
    }

    #[test]
    fn precedence_is_that_of_mathematics() {
        for (text, exact) in [
            ("-x^2", -9.0),
            ("2^3^2", 512.0),
            ("2^-x", 0.125),
            ("8-3-2", 3.0),
            ("8/4/2", 1.0),
            ("1e-3*x", 3e-3),
            ("1.5*(1 - x^2)", -12.0),
            ("2*-x + +1", -5.0),
            ("max(x, 2*t) - min(t, x)", 2.75),
            ("sin(2*pi*t)", 1.0),
            ("1-.5e+1", -4.0),
            ("sqrt(abs(-x*3))/tanh(100)", 3.0),
            ("((((x))))", 3.0),
        ] {
            assert!((value(text) - exact).abs() < 1e-15 * exact.abs().max(1.0), "{text} = {}", value(text));
        }
    }

    #[test]
    fn errors_name_the_character() {
        for (text, column, what) in [
            ("", 1, "is missing"),
            ("2x", 2, "operator is missing before `x`"),
            ("1 + r^2", 5, "unknown name `r` (known: x, t, pi, sin"),
            ("(1 + x", 7, "`)` is missing"),
            ("x)", 2, "operator is missing"),
            ("1.2.3", 1, "`1.2.3` is not a number"),
            ("1e999", 1, "not a number"),
            ("x ** 2", 4, "before `*`"),
            ("sin x", 5, "`(` is missing after `sin`"),
            ("max(x)", 6, "`,` is missing"),
            ("x > 1", 3, "before `>`"),
            ("2 · x", 3, "before `·`"),
        ] {
            let error = Formula::parse(text, &["x", "t"]).expect_err(text);
            assert!(error.to_string().contains(what) && error.column == column, "{text}: {error:?}");
        }
        let deep = format!("{}1{}", "(1+".repeat(40), ")".repeat(40));
        assert!(Formula::parse(&deep, &[]).unwrap_err().what.contains("nested"));
        let long = "1+".repeat(300);
        assert!(Formula::parse(&long, &[]).unwrap_err().what.contains("400 characters"));
    }
}
