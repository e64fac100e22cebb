//! The text of every definition, for the schemas of recordings.

/// One `.msg` file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Definition {
    /// `package/Type`.
    pub name: &'static str,
    /// The file's text.
    pub text: &'static str,
    /// The fields in order.
    pub fields: &'static [Field],
}

/// A field of a definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// `float64[36]`, `geometry_msgs/Vector3`, ...: always with the package.
    pub ty: &'static str,
    /// The field's name.
    pub name: &'static str,
}

include!(concat!(env!("OUT_DIR"), "/definitions.rs"));

/// The definition of `package/Type` or `package/msg/Type`.
#[must_use]
pub fn find(name: &str) -> Option<Definition> {
    let (package, ty) = name.split_once('/')?;
    let ty = ty.strip_prefix("msg/").unwrap_or(ty);
    DEFINITIONS.iter().copied().find(|d| d.name.split_once('/') == Some((package, ty)))
}

impl Definition {
    /// The schema text that rosbag2 stores (encoding `ros2msg`): this definition, then every
    /// definition that it needs, each behind a line of 80 `=` and a line `MSG: package/Type`.
    #[must_use]
    pub fn schema(&self) -> String {
        let mut text = self.text.to_owned();
        let mut queue = vec![*self];
        let mut seen = vec![self.name];
        while let Some(definition) = queue.pop() {
            for field in definition.fields {
                let element = field.ty.split('[').next().unwrap_or_default();
                if let Some(needed) = find(element).filter(|d| !seen.contains(&d.name)) {
                    seen.push(needed.name);
                    queue.push(needed);
                    text.push_str(&format!("{}\nMSG: {}\n{}", "=".repeat(80), needed.name, needed.text));
                }
            }
        }
        text
    }
}
