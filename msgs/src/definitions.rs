//! The text of every definition, for the schemas of recordings and for the conformity test.

/// One `.msg` file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Definition {
    /// `package/Type`.
    pub name: &'static str,
    /// The file's text.
    pub text: &'static str,
}

macro_rules! definitions {
    ($($folder:literal $package:literal: $($ty:literal)+;)+) => {
        /// Every definition in `msg/` and `standard/`.
        pub const DEFINITIONS: &[Definition] = &[$($(Definition {
            name: concat!($package, "/", $ty),
            text: include_str!(concat!("../", $folder, "/", $ty, ".msg")),
        }),+),+];
    };
}

definitions! {
    "standard/builtin_interfaces" "builtin_interfaces": "Time";
    "standard/std_msgs" "std_msgs": "Header";
    "standard/geometry_msgs" "geometry_msgs":
        "Vector3" "Quaternion" "Vector3Stamped" "Transform" "TransformStamped";
    "standard/tf2_msgs" "tf2_msgs": "TFMessage";
    "standard/sensor_msgs" "sensor_msgs": "Imu" "JointState" "FluidPressure" "Temperature" "BatteryState";
    "standard/diagnostic_msgs" "diagnostic_msgs": "KeyValue" "DiagnosticStatus" "DiagnosticArray";
    "msg" "whorl_msgs":
        "ActuatorCommand" "AttitudeEstimate" "AttitudeReference" "ClockReply" "ClockRequest" "ControlStatus"
        "Excitation" "FormationCommand" "FormationState" "ParameterEstimate" "ThrusterState";
}

/// The definition of `package/Type` or `package/msg/Type`.
#[must_use]
pub fn find(name: &str) -> Option<Definition> {
    let (package, ty) = name.split_once('/')?;
    let ty = ty.strip_prefix("msg/").unwrap_or(ty);
    DEFINITIONS.iter().copied().find(|d| d.name.split_once('/') == Some((package, ty)))
}

/// A line of a definition that declares a field: its type as written and its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// `float64[36]`, `geometry_msgs/Vector3`, ...
    pub ty: &'static str,
    /// The field's name.
    pub name: &'static str,
}

impl Definition {
    /// The fields in order; comments and constants are left out.
    pub fn fields(&self) -> impl Iterator<Item = Field> + use<> {
        self.text.lines().filter_map(|line| {
            let code = line.split('#').next().unwrap_or_default();
            let mut words = code.split_whitespace();
            let (ty, name) = (words.next()?, words.next()?);
            // A constant is `TYPE NAME=value`, the equals sign with or without blanks around it.
            let constant = name.contains('=') || words.next().is_some_and(|w| w.starts_with('='));
            (!constant).then_some(Field { ty, name })
        })
    }

    /// The schema text that rosbag2 stores (encoding `ros2msg`): this definition, then every
    /// definition that it needs, each behind a line of 80 `=` and a line `MSG: package/Type`.
    #[must_use]
    pub fn schema(&self) -> String {
        let mut text = self.text.to_owned();
        let mut queue = vec![*self];
        let mut seen = vec![self.name];
        while let Some(definition) = queue.pop() {
            for field in definition.fields() {
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
