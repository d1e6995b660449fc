//! The text files of COLMAP: one entry a line (two for images), comments after `#`.

use std::path::Path;
use std::str::FromStr;

use super::lens::{Lens, ModelName, Placed, model_of};
use crate::error::{Error, Result};
use crate::photographs::draft::finite;

/// The fields of a line.
struct Line<'a> {
    file: &'a Path,
    number: usize,
    rest: &'a str,
}

impl<'a> Line<'a> {
    /// Returns the next field.
    fn next(&mut self, what: &str) -> Result<&'a str> {
        let rest = self.rest.trim_start();
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        let (field, rest) = rest.split_at(end);
        self.rest = rest;
        match field.is_empty() {
            true => Err(self.wrong(&format!("{what} is missing"))),
            false => Ok(field),
        }
    }

    fn parse<T: FromStr>(&mut self, what: &str) -> Result<T> {
        let field = self.next(what)?;
        field
            .parse()
            .map_err(|_| self.wrong(&format!("{what} is {field:?}, expected a number")))
    }

    fn floats<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.parse(what)?;
            finite(self.file, &format!("line {}", self.number), what, *number)?;
        }
        Ok(numbers)
    }

    fn wrong(&self, message: &str) -> Error {
        Error::format(self.file, format!("line {}: {message}", self.number))
    }
}

/// Returns the lines that hold entries. With `pairs`, the line after each of them belongs to it and is left out.
fn lines<'a>(file: &'a Path, text: &'a str, pairs: bool) -> Vec<Line<'a>> {
    let mut all = text.lines().enumerate();
    let mut lines = Vec::new();
    while let Some((i, line)) = all.next() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        lines.push(Line {
            file,
            number: i + 1,
            rest: line,
        });
        if pairs {
            all.next();
        }
    }
    lines
}

/// Reads `cameras.txt`: the cameras by their numbers.
pub(super) fn cameras(file: &Path, text: &str) -> Result<Vec<(u32, Lens)>> {
    let read = |mut line: Line| {
        let id = line.parse("number of the camera")?;
        let name = line.next("model")?;
        let place = format!("line {}: camera {id}", line.number);
        let (model, count) = model_of(file, &place, ModelName::Text(name))?;
        let size = [line.parse("width")?, line.parse("height")?];
        let parameters = (0..count).map(|_| line.floats::<1>("parameter").map(|[v]| v));
        let parameters = parameters.collect::<Result<_>>()?;
        let lens = Lens {
            model,
            size,
            parameters,
        };
        Ok((id, lens))
    };
    lines(file, text, false).into_iter().map(read).collect()
}

/// Reads `images.txt`: the images by their numbers. The second line of each, its features, is left out and may be empty.
pub(super) fn images(file: &Path, text: &str) -> Result<Vec<(u32, Placed)>> {
    let read = |mut line: Line| {
        let id = line.parse("number of the image")?;
        let quaternion = line.floats("rotation")?;
        let translation = line.floats("translation")?;
        let camera = line.parse("number of the camera")?;
        // A name may contain spaces.
        let name = line.rest.trim().to_owned();
        if name.is_empty() {
            return Err(line.wrong("name is missing"));
        }
        let image = Placed {
            quaternion,
            translation,
            camera,
            name,
        };
        Ok((id, image))
    };
    lines(file, text, true).into_iter().map(read).collect()
}

/// Reads `points3D.txt`: the places of the points.
pub(super) fn points(file: &Path, text: &str) -> Result<Vec<[f64; 3]>> {
    let read = |mut line: Line| {
        line.next("number of the point")?;
        line.floats("coordinate")
    };
    lines(file, text, false).into_iter().map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_lines_of_features_are_left_out() {
        let text = "# comment\n\n1 1 0 0 0 1 2 3 5 a b.png\n\n2 1 0 0 0 4 5 6 5 c.png\n0.5 1 -1\n";
        let found = images(Path::new("images.txt"), text).expect("two images");
        let names: Vec<&str> = found.iter().map(|(_, image)| &image.name[..]).collect();
        assert_eq!(names, ["a b.png", "c.png"]);
        assert_eq!(found[1].1.translation, [4.0, 5.0, 6.0]);
    }

    #[test]
    fn wrong_fields_are_named() {
        let file = Path::new("cameras.txt");
        for (text, expected) in [
            ("1 PINHOLE 4 4 1 1 2", "line 1: parameter is missing"),
            ("1 PINHOLE 4 4 1 1 2 NaN", "line 1: parameter is NaN"),
            ("\n1 FOV 4 4 1 1 2 2 1", "line 2: camera 1: model is FOV"),
            ("1 PINHOLE x 4 1 1 2 2", r#"width is "x""#),
        ] {
            let error = cameras(file, text).expect_err("an error").to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
