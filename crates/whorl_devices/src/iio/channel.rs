//! The files of one channel (Linux, Documentation/ABI/testing/sysfs-bus-iio).

use std::path::Path;

use whorl_params::Reader;

use crate::DeviceError;
use crate::device::Address;

/// The parameter that says where a converter's files are.
pub(super) fn folder(r: &mut Reader<'_>) -> String {
    r.string("folder", "folder of the converter, such as /sys/bus/iio/devices/iio:device0")
}

/// What no two devices may share.
pub(super) fn address(folder: &str, channel: &str) -> Address {
    Address(format!("{folder}/{channel}"))
}

/// Raw number, offset (0 where there is none) and scale of a channel such as `in_voltage0` or `in_anglvel_x`. One scale for
/// all channels of a type is as good as one for each.
pub(super) fn read(folder: &Path, channel: &str) -> Result<[f64; 3], DeviceError> {
    let number = |file: &str| {
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path)
            .map_err(DeviceError::io("cannot read", &path.display().to_string()))?;
        let number = text.trim().parse::<f64>().ok().filter(|x| x.is_finite());
        number.ok_or_else(|| {
            DeviceError::Refused(format!("{} holds no number: {:?}", path.display(), text.trim()))
        })
    };
    let shared = match channel.rsplit_once('_') {
        Some((kind, "x" | "y" | "z")) => kind,
        _ => channel.trim_end_matches(|c: char| c.is_ascii_digit()),
    };
    let raw = number(&format!("{channel}_raw"))?;
    let scale = number(&format!("{channel}_scale")).or_else(|_| number(&format!("{shared}_scale")))?;
    let offset =
        number(&format!("{channel}_offset")).or_else(|_| number(&format!("{shared}_offset"))).unwrap_or(0.0);
    Ok([raw, offset, scale])
}
