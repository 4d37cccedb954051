//! The form of commands as text, in which tests record them.

use std::fmt::{self, Write};

use crate::graph::{Bound, Linked, Program};
use crate::plan::commands::PassConstants;
use crate::plan::{Command, Commands, EyeImage, Groups, Launched, Outgoing, Rows};
use crate::wgsl::Words;

/// Returns the commands as text, one per line, and one for each launch of a dispatch.
pub fn text_of(commands: &Commands, program: &Program) -> String {
    let mut out = String::new();
    for (i, command) in commands.list.iter().enumerate() {
        if i == commands.own {
            out += "stitch\n";
        }
        write_command(&mut out, command, program).unwrap();
    }
    out
}

fn write_command(out: &mut String, command: &Command, program: &Program) -> fmt::Result {
    match command {
        Command::Begin => writeln!(out, "begin"),
        Command::Clear(image) => writeln!(out, "clear {image}"),
        Command::Dispatch { pass, launches, begins, ends } => {
            let stamps: Vec<String> = begins.iter().chain(ends).map(|stamp| format!(" @{stamp}")).collect();
            writeln!(out, "dispatch {}{}", pass_name(&program.passes()[*pass]), stamps.concat())?;
            launches
                .iter()
                .try_for_each(|launched| write_launch(out, launched, program.passes()[*pass].pass.kernel.arguments))
        }
        Command::Build { pass, ends } => {
            let stamp = ends.map(|stamp| format!(" @{stamp}")).unwrap_or_default();
            writeln!(out, "build after {}{stamp}", pass_name(&program.passes()[*pass]))
        }
        Command::Save { image, .. } => writeln!(out, "save {image}"),
        Command::Restore { image, .. } => writeln!(out, "restore {image}"),
        Command::CopyOut { transfer, rows } => writeln!(out, "copy out #{transfer} {rows}"),
        Command::CopyIn { transfer, rows } => writeln!(out, "copy in #{transfer} {rows}"),
        Command::Stamps => writeln!(out, "copy timestamps"),
        Command::Ask => writeln!(out, "ask for the pose"),
        Command::Close => writeln!(out, "close"),
        Command::Submit(copies) => {
            let copies: Vec<String> =
                copies.iter().map(|Outgoing { transfer, to, .. }| format!(" #{transfer} to {to}")).collect();
            writeln!(out, "submit{}", copies.join(","))
        }
        Command::Probe { task, .. } => writeln!(out, "probe task {task}"),
        Command::Inject(kind) => writeln!(out, "inject {}", kind.name()),
    }
}

fn pass_name(linked: &Linked) -> String {
    format!("{}[{}] {}", linked.pass.stage.name(), linked.pass.index, linked.pass.view)
}

impl fmt::Display for EyeImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Bound { buffer, .. } = self.bound;
        let version = if buffer == 0 { String::new() } else { format!("/{buffer}") };
        write!(f, "{}{version} {}", self.bound.name(), self.eye)
    }
}

impl fmt::Display for Rows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} rows {}..{}", self.image, self.rows.start, self.rows.end)
    }
}

fn write_launch(out: &mut String, launched: &Launched, arguments: &[(&str, &str)]) -> fmt::Result {
    let PassConstants { row_begin, row_end, valid_begin, valid_end, args: Words(words), .. } = launched.constants;
    write!(out, "    rows {row_begin}..{row_end} of {valid_begin}..{valid_end}, ")?;
    for ((name, of), word) in arguments.iter().zip(words) {
        match *of {
            "f32" => write!(out, "{name} {}, ", f32::from_bits(word))?,
            _ => write!(out, "{name} {word}, ")?,
        }
    }
    if launched.jitter {
        write!(out, "jittered, ")?;
    }
    match &launched.groups {
        Groups::Direct([x, y, z]) => writeln!(out, "{x}x{y}x{z} groups"),
        Groups::Listed(list) => writeln!(out, "groups listed in {}", list.name),
    }
}
