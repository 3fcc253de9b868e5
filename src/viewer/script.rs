//! `--script FILE` plays events from a file instead of a person's. Each line is an event that is played
//! before a frame of the window. [`LINES`] lists the events.

use crate::{Error, Result, gpu::PresentMode, image_file::read::read_bytes};
use std::path::{Path, PathBuf};

/// What a script may hold, for `--help`.
pub const LINES: &str = "\
Lines of a script; `#` begins a comment, and after the last line the window closes:
  @N                   before any other: not before frame N of the window
  key K, hold K, release K
                       a key, by egui's name, with ctrl+, shift+, alt+ before it
  click B X,Y, press B X,Y, lift B X,Y, move X,Y
                       the pointer; B is left or right, X,Y points of the window
  drag B X,Y X,Y       presses, moves in eight frames, lifts
  wheel N              N notches, away from the hand
  size WxH             resizes the window
  close                asks the window to close, as its button does
  lose                 takes the window's surface for lost, as a driver may say
  present MODE         when frames reach the screen: fifo, mailbox or immediate
  drop FILE            drops a file on it
  wait N               lets N frames of the window pass
  settle N             waits until every picture that is shown has its full size and N frames
  await FILE           waits until there is such a file
  objects N            waits until the scene has N objects
  errors N             waits until N things have gone wrong
  screenshot FILE      A's picture, .png or .exr, and waits until it is written
  set A|B KEY=VALUE    a setting
  material KEY=VALUE   a value of the selected object's materials: a number or R,G,B; nothing after = takes it back
  save PATH            saves the scene
  note WORD            puts the state of the session into the report";

/// One line of a script.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    Key {
        key: egui::Key,
        modifiers: egui::Modifiers,
        down: bool,
    },
    Move(egui::Pos2),
    Button {
        button: egui::PointerButton,
        at: egui::Pos2,
        down: bool,
    },
    Wheel(f32),
    Size([u32; 2]),
    Close,
    Lose,
    Present(PresentMode),
    Drop(PathBuf),
    Wait(u64),
    Settle(u32),
    Await(PathBuf),
    Objects(usize),
    Errors(usize),
    Screenshot(PathBuf),
    Set {
        side: usize,
        pair: String,
    },
    Material(String),
    Save(PathBuf),
    Note(String),
    /// Waits until this frame.
    Frame(u64),
}

/// All lines, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    steps: std::collections::VecDeque<Step>,
}

impl Script {
    /// Reads a script from a file.
    ///
    /// # Errors
    /// Fails if the file cannot be read, or at the first line that is not understood.
    pub fn read(path: &Path) -> Result<Self> {
        let text = String::from_utf8(read_bytes(path)?)
            .map_err(|_| Error::input(path.display(), "is not a text file", "give a script"))?;
        Self::parse(path, &text)
    }

    fn parse(path: &Path, text: &str) -> Result<Self> {
        let mut script = Self::default();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            let problem = |what: &str| {
                let subject = format!("{}: line {}", path.display(), number + 1);
                Error::input(
                    subject,
                    format!("\"{line}\": {what}"),
                    "see `iprt view --help` for what a script may hold",
                )
            };
            let mut words: Vec<&str> = line.split_whitespace().collect();
            if let Some(frame) = words.first().and_then(|word| word.strip_prefix('@')) {
                script.steps.push_back(Step::Frame(frame.parse().map_err(|_| problem("no frame number"))?));
                words.remove(0);
            }
            if !words.is_empty() {
                script.steps.extend(line_steps(&words).map_err(problem)?);
            }
        }
        Ok(script)
    }

    /// The next step.
    pub fn next(&self) -> Option<&Step> {
        self.steps.front()
    }

    /// Takes the next step, and proceeds to the one after it.
    pub fn done(&mut self) -> Option<Step> {
        self.steps.pop_front()
    }
}

fn line_steps(words: &[&str]) -> std::result::Result<Vec<Step>, &'static str> {
    let place = |text: &str| -> std::result::Result<egui::Pos2, &'static str> {
        let (x, y) = text.split_once(',').ok_or("a place is X,Y")?;
        let number = |text: &str| text.trim().parse::<f32>().ok().filter(|n| n.is_finite()).ok_or("a place is X,Y");
        Ok(egui::pos2(number(x)?, number(y)?))
    };
    let button = |text: &str| match text {
        "left" => Ok(egui::PointerButton::Primary),
        "right" => Ok(egui::PointerButton::Secondary),
        _ => Err("a button is left or right"),
    };
    let count = |text: &str| text.parse::<u64>().map_err(|_| "not a number");
    let file = |text: &str| PathBuf::from(text);
    Ok(match words {
        ["key", name] => {
            let (key, modifiers) = named_key(name)?;
            vec![Step::Key { key, modifiers, down: true }, Step::Key { key, modifiers, down: false }]
        }
        [way @ ("hold" | "release"), name] => {
            let (key, modifiers) = named_key(name)?;
            vec![Step::Key { key, modifiers, down: *way == "hold" }]
        }
        ["move", at] => vec![Step::Move(place(at)?)],
        ["press", name, at] => {
            let (button, at) = (button(name)?, place(at)?);
            vec![Step::Move(at), Step::Button { button, at, down: true }]
        }
        ["lift", name, at] => vec![Step::Button { button: button(name)?, at: place(at)?, down: false }],
        ["click", name, at] => {
            let (button, at) = (button(name)?, place(at)?);
            vec![Step::Move(at), Step::Button { button, at, down: true }, Step::Button { button, at, down: false }]
        }
        ["drag", name, from, to] => {
            let (button, from, to) = (button(name)?, place(from)?, place(to)?);
            let mut steps = vec![Step::Move(from), Step::Button { button, at: from, down: true }];
            steps.extend((1..=8).map(|k| Step::Move(from + (to - from) * (k as f32 / 8.0))));
            steps.push(Step::Button { button, at: to, down: false });
            steps
        }
        ["wheel", notches] => vec![Step::Wheel(notches.parse().map_err(|_| "not a number")?)],
        ["size", size] => {
            let (width, height) = size.split_once('x').ok_or("a size is WxH")?;
            let number = |text: &str| text.parse::<u32>().map_err(|_| "a size is WxH");
            vec![Step::Size([number(width)?, number(height)?])]
        }
        ["close"] => vec![Step::Close],
        ["lose"] => vec![Step::Lose],
        ["present", name] => {
            let mode = PresentMode::ALL.into_iter().find(|mode| mode.name() == *name);
            vec![Step::Present(mode.ok_or("a mode is fifo, mailbox or immediate")?)]
        }
        ["drop", path] => vec![Step::Drop(file(path))],
        ["wait", frames] => vec![Step::Wait(count(frames)?)],
        ["settle", frames] => vec![Step::Settle(count(frames)?.try_into().map_err(|_| "too many frames")?)],
        ["await", path] => vec![Step::Await(file(path))],
        ["objects", number] => vec![Step::Objects(count(number)? as usize)],
        ["errors", number] => vec![Step::Errors(count(number)? as usize)],
        ["screenshot", path] => vec![Step::Screenshot(file(path))],
        ["set", side, pair] => {
            let side = ["A", "B"].iter().position(|name| name == side).ok_or("a side is A or B")?;
            vec![Step::Set { side, pair: (*pair).to_owned() }]
        }
        ["material", pair] => vec![Step::Material((*pair).to_owned())],
        ["save", path] => vec![Step::Save(file(path))],
        ["note", word] => vec![Step::Note((*word).to_owned())],
        _ => return Err("not understood"),
    })
}

fn named_key(name: &str) -> std::result::Result<(egui::Key, egui::Modifiers), &'static str> {
    let mut modifiers = egui::Modifiers::NONE;
    let mut key = name;
    loop {
        let (modifier, rest) = match key.split_once('+') {
            Some(("ctrl", rest)) => (egui::Modifiers::COMMAND | egui::Modifiers::CTRL, rest),
            Some(("shift", rest)) => (egui::Modifiers::SHIFT, rest),
            Some(("alt", rest)) => (egui::Modifiers::ALT, rest),
            _ => break,
        };
        modifiers |= modifier;
        key = rest;
    }
    egui::Key::from_name(key).map(|key| (key, modifiers)).ok_or("there is no such key")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read() {
        let text = "# a comment\n@3 key ctrl+Z # undo\nclick left 10,20\nsize 64x48\n\nset B history=3\n";
        let mut script = Script::parse("a.txt".as_ref(), text).unwrap();
        assert_eq!(script.done(), Some(Step::Frame(3)));
        let Some(Step::Key { key, modifiers, down: true }) = script.done() else { panic!() };
        assert!(key == egui::Key::Z && modifiers.ctrl && !modifiers.shift);
        assert_eq!(script.steps.len(), 1 + 3 + 1 + 1);
        assert_eq!(script.steps[5], Step::Set { side: 1, pair: "history=3".into() });
    }

    #[test]
    fn what_is_not_understood_names_its_line() {
        for line in ["jump", "key Q Q", "key Nokey", "click middle 1,1", "move 3", "size 3", "@x wait 1", "wait -1"] {
            let error = Script::parse("a.txt".as_ref(), &format!("wait 1\n{line}")).unwrap_err();
            assert!(error.to_string().starts_with("a.txt: line 2: "), "{error}");
            assert_eq!(error.exit_code(), 2);
        }
    }
}
