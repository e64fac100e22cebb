//! Layers of parameter files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use whorl_files::read_text;
use whorl_math::words::nearest;

use crate::command_line::Override;
use crate::error::{Origin, ParameterError, ParameterErrors};

use crate::missing::missing;
use crate::node_parameters::{Entry, NodeParameters};
use crate::sections::{Section, sections, sections_for};

/// The content of all parameter files and `-p` arguments, in layers.
#[derive(Debug, Clone, Default)]
pub struct ParameterTree {
    files: Vec<Layer>,
    overrides: Vec<Override>,
}

#[derive(Debug, Clone)]
struct Layer {
    file: Arc<str>,
    sections: Vec<Section>,
}

impl ParameterTree {
    /// Reads parameter files, lowest layer first, and adds `-p` arguments on top.
    ///
    /// # Errors
    /// Everything that is wrong with the form of any of the files. Keys, types and ranges are
    /// checked when a node reads its parameters.
    pub fn load(files: &[PathBuf], overrides: &[Override]) -> Result<Self, ParameterErrors> {
        let mut errors = Vec::new();
        let mut texts = Vec::new();
        for path in files {
            match read_text(path) {
                Ok(text) => texts.push((path.display().to_string(), text)),
                Err(error) => errors.push(unreadable(path, &error)),
            }
        }
        let texts: Vec<(&str, &str)> =
            texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
        match Self::from_texts(&texts, overrides) {
            Ok(tree) => ParameterErrors::check(errors).map(|()| tree),
            Err(more) => {
                errors.extend(more.iter().cloned());
                ParameterErrors::check(errors).map(|()| Self::default())
            }
        }
    }

    /// Reads a file that is for one reader alone, such as the map of a CSV file. Its section may be written as
    /// everywhere, `<node>: ros__parameters:`, or without `ros__parameters`, or the keys may stand alone.
    ///
    /// # Errors
    /// Everything that is wrong with the form of the file; sections for another name than `node`.
    pub fn load_for(path: &Path, node: &str) -> Result<NodeParameters, ParameterErrors> {
        let file: Arc<str> = path.display().to_string().into();
        let text = read_text(path).map_err(|error| ParameterErrors::from(unreadable(path, &error)))?;
        let mut errors = Vec::new();
        let sections = sections_for(&file, &text, node, &mut errors);
        ParameterErrors::check(errors)?;
        let tree = Self { files: vec![Layer { file, sections }], overrides: Vec::new() };
        let name = format!("/{node}");
        tree.check_sections([name.as_str()])?;
        Ok(tree.for_node(&name))
    }

    /// As [`Self::load`], from (file name, content) pairs.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_texts(texts: &[(&str, &str)], overrides: &[Override]) -> Result<Self, ParameterErrors> {
        let mut errors = Vec::new();
        let mut files = Vec::new();
        for (name, text) in texts {
            let file: Arc<str> = (*name).into();
            files.push(Layer { sections: sections(&file, text, &mut errors), file });
        }
        ParameterErrors::check(errors)?;
        Ok(Self { files, overrides: overrides.to_vec() })
    }

    /// The parameters of one node, by its fully qualified name: later files win; within a file the
    /// more specific section wins; `-p` wins over files.
    #[must_use]
    pub fn for_node(&self, node: &str) -> NodeParameters {
        let node = if node.starts_with('/') { node.to_owned() } else { format!("/{node}") };
        let mut parameters =
            NodeParameters::new(&node, self.files.iter().map(|layer| layer.file.clone()).collect());
        for layer in &self.files {
            let mut matching: Vec<&Section> =
                layer.sections.iter().filter(|section| section.pattern.matches(&node)).collect();
            // Stable: of equally specific sections the later one wins.
            matching.sort_by_key(|section| section.pattern.specificity());
            for entry in matching.iter().flat_map(|section| &section.entries) {
                parameters.insert(entry.clone());
            }
        }
        for argument in self.overrides.iter().filter(|argument| argument.applies_to(&node)) {
            parameters.insert(Entry {
                key: argument.key().to_owned(),
                value: argument.value().clone(),
                origin: Origin::CommandLine,
            });
        }
        parameters
    }

    /// The namespaces (first parts of section names, `whorl_1` of `/whorl_1/**`) that hold a key of a shared
    /// group, in the order in which they first appear; wildcards are no namespace.
    #[must_use]
    pub fn namespaces_with(&self, group: &str) -> Vec<String> {
        let prefix = format!("{group}.");
        let mut found: Vec<String> = Vec::new();
        for section in self.files.iter().flat_map(|layer| &layer.sections) {
            let Some(name) = section.pattern.namespace() else { continue };
            let holds = section.entries.iter().any(|entry| entry.key.starts_with(&prefix));
            if holds && !found.iter().any(|known| known == name) {
                found.push(name.to_owned());
            }
        }
        found
    }

    /// Refuses sections that match no existing node: a mistyped node name would
    /// otherwise be ignored in silence.
    ///
    /// # Errors
    /// One for each such section, with the nearest node name.
    pub fn check_sections<'a>(
        &self,
        nodes: impl IntoIterator<Item = &'a str> + Clone,
    ) -> Result<(), ParameterErrors> {
        let mut errors = Vec::new();
        for layer in &self.files {
            for section in &layer.sections {
                if nodes.clone().into_iter().any(|node| section.pattern.matches(node)) {
                    continue;
                }
                let name = section.pattern.to_string();
                let hint = likely_node(&name, nodes.clone());
                errors.push(ParameterError::new(
                    Origin::File { file: layer.file.clone(), line: section.line },
                    format!("section {name} matches no node; {hint}"),
                ));
            }
        }
        ParameterErrors::check(errors)
    }

    /// Refuses `-p` arguments for a node that does not exist, as [`Self::check_nodes`] does sections. A node alone does not:
    /// it may be given what is meant for another.
    ///
    /// # Errors
    /// One for each such argument, with the nearest node name.
    pub fn check_overrides(&self) -> Result<(), ParameterErrors> {
        let nodes: Vec<String> = self.node_set().into_iter().map(|instance| instance.name).collect();
        let names = || nodes.iter().map(String::as_str);
        let unknown = self.overrides.iter().filter(|argument| !names().any(|node| argument.applies_to(node)));
        let error = |argument: &Override| {
            let node = argument.node();
            let hint = likely_node(&node, names());
            ParameterError::new(Origin::CommandLine, format!("{node} matches no node; {hint}"))
                .with_value(format!("{node}:{}", argument.key()))
        };
        ParameterErrors::check(unknown.map(error).collect())
    }

    /// Names of the files, lowest layer first.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(|layer| &*layer.file)
    }
}

/// The node that a name may stand for, else all that there are.
fn likely_node<'a>(name: &str, nodes: impl IntoIterator<Item = &'a str> + Clone) -> String {
    nearest(name, nodes.clone()).map_or_else(
        || format!("the nodes are {}", nodes.into_iter().collect::<Vec<_>>().join(", ")),
        |node| format!("did you mean {node}?"),
    )
}

fn unreadable(path: &Path, error: &std::io::Error) -> ParameterError {
    let problem = match error.kind() {
        std::io::ErrorKind::NotFound => missing(path),
        _ => format!("cannot be read: {error}"),
    };
    ParameterError::new(Origin::File { file: path.display().to_string().into(), line: 0 }, problem)
}

/// The usual layers of a parameter directory, lowest first: `common.yaml`, `<platform>.yaml` and
/// `truth/<platform>.yaml` of each platform, then the experiment. Files that do not exist are left
/// out, except `common.yaml` and the experiment, so that their absence is reported.
#[must_use]
pub fn standard_layers(directory: &Path, platforms: &[&str], experiment: Option<&Path>) -> Vec<PathBuf> {
    let mut files = vec![directory.join("common.yaml")];
    for platform in platforms {
        let own = [format!("{platform}.yaml"), format!("truth/{platform}.yaml")];
        files.extend(own.iter().map(|name| directory.join(name)).filter(|path| path.is_file()));
    }
    files.extend(experiment.map(Path::to_path_buf));
    files
}

/// [`standard_layers`] of an experiment: with the files of the platforms that it or `common.yaml` names.
///
/// # Errors
/// As [`ParameterTree::load`]; a platform without a file of its own and without a model in the other files.
pub fn layers_of_experiment(directory: &Path, experiment: &Path) -> Result<Vec<PathBuf>, ParameterErrors> {
    let tree = ParameterTree::load(&standard_layers(directory, &[], Some(experiment)), &[])?;
    let platforms = tree.formation().platforms;
    let has_model =
        |platform: &String| !tree.for_node(&format!("/{platform}/estimator")).children("model").is_empty();
    let mut errors = Vec::new();
    for platform in platforms.iter().filter(|platform| !has_model(platform)) {
        let file = directory.join(format!("{platform}.yaml"));
        if !file.is_file() {
            let named = format!("formation.platforms names {platform}, and this file {}", missing(&file));
            let origin = Origin::File { file: file.display().to_string().into(), line: 0 };
            errors.push(ParameterError::new(origin, named));
        }
    }
    ParameterErrors::check(errors)?;
    let names: Vec<&str> = platforms.iter().map(String::as_str).collect();
    Ok(standard_layers(directory, &names, Some(experiment)))
}
