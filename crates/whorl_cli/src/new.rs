//! `whorl new`: from a file of somebody's sensors to the two files that the other commands need.

use std::io::{BufRead as _, IsTerminal as _};
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use serde_json::json;
use whorl_commands::new_rig::next::Next;
use whorl_commands::new_rig::questions::{Ask, Nobody};
use whorl_commands::new_rig::{NewRig, Preset, new_rig};
use whorl_math::words::shell_word;

use crate::output::{self, JsonArgument, ask, say};

#[derive(Debug, Args)]
pub struct Arguments {
    /// CSV file, rosbag2 directory, .mcap file, or folder with a CSV file for each sensor, as apps on phones write them.
    file: PathBuf,
    /// Folder that gets the platform's file and the map of channels.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    out: PathBuf,
    /// Kind of rig: table (on an air bearing or a ball), hinge (a pendulum, a turntable), wheel_bench (wheels in a stand), free (a
    /// spacecraft, a drone) [default: what the file looks like].
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(Preset::ALL.map(|(word, _)| word)))]
    rig: Option<String>,
    /// Asks nothing: what the file does not show is marked `assumed` [default: asks where there is a terminal].
    #[arg(long)]
    no_questions: bool,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl new`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let preset = Preset::ALL.iter().find(|(word, _)| arguments.rig.as_deref() == Some(*word));
    let preset = preset.map(|(_, preset)| *preset);
    let somebody = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
    let made = if somebody && !arguments.no_questions {
        new_rig(&arguments.file, &arguments.out, preset, &mut Terminal)?
    } else {
        new_rig(&arguments.file, &arguments.out, preset, &mut Nobody)?
    };
    tell(&made);
    arguments.json.write(|| Ok(as_json(&made)))
}

fn tell(made: &NewRig) {
    for (channel, samples) in &made.samples {
        say!("  {channel:<22} {samples:>9}");
    }
    if !made.ignored.is_empty() {
        say!("not used: {}", made.ignored.join(", "));
        say!(
            "  What are they? On a terminal `whorl new` asks; a column's name says it as well: gyro_x_deg_s, wheel_speed_1_rpm, \
             wheel_torque_command_1_mn_m."
        );
    }
    for note in &made.notes {
        say!("note: {note}");
    }
    say!("platform: {}", made.rig.display());
    say!("channels: {}", made.map.display());
    match made.assumed() {
        0 => say!("Every line was measured, stated or answered."),
        1 => say!("1 line is assumed, as the file cannot say it: look for `assumed` in both files."),
        count => {
            say!("{count} lines are assumed, as the file cannot say them: look for `assumed` in both files.")
        }
    }
    for reason in &made.refused {
        say!("to be corrected first: {reason}");
    }
    let command = made.next.arguments(&made.file, &made.map, &made.rig);
    let quoted =
        |arguments: Vec<String>| arguments.iter().map(|word| shell_word(word)).collect::<Vec<_>>().join(" ");
    let command = command.map(|arguments| format!("whorl {}", quoted(arguments))).unwrap_or_default();
    match &made.next {
        Next::Compare => say!("next: {command}"),
        Next::Estimate(why) => say!("next: {command}   (no comparison with a model: {why})"),
        Next::Missing(what) => say!("next: no command explains this recording as it is: {what}."),
    }
}

fn as_json(made: &NewRig) -> serde_json::Value {
    let lines: Vec<_> = made
        .lines
        .iter()
        .filter_map(|line| {
            let (origin, words) = line.source.as_ref()?;
            Some(json!({"line": line.text, "from": origin.word(), "how": words}))
        })
        .collect();
    let next = made.next.arguments(&made.file, &made.map, &made.rig);
    let missing = if let Next::Missing(what) = &made.next { Some(what) } else { None };
    json!({
        "schema": 1, "platform": made.platform, "recording": made.file, "model": made.rig, "channels": made.map, "lines": lines,
        "samples": made.samples.iter().map(|(name, count)| json!({"channel": name, "samples": count})).collect::<Vec<_>>(),
        "not_used": made.ignored, "notes": made.notes, "to_be_mended": made.refused, "assumed": made.assumed(),
        "next": next, "missing": missing,
    })
}

/// Whoever sits at the terminal. Questions go to the standard error: the output may be for a program.
struct Terminal;

impl Ask for Terminal {
    fn ask(&mut self, question: &str, suggested: &str) -> Option<String> {
        ask(&format!("{question} [{suggested}]: ")).ok()?;
        let mut answer = String::new();
        match std::io::stdin().lock().read_line(&mut answer) {
            Ok(0) | Err(_) => {
                // Ctrl-D leaves the cursor behind the question.
                output::tell("");
                None
            }
            Ok(_) => Some(answer),
        }
    }

    fn object(&mut self, why: &str) {
        output::tell(why);
    }
}
