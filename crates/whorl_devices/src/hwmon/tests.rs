//! Channels against the units that the kernel's documentation prints, chips against their names, wrong entries.

use super::*;

fn chip(folder: &Path, name: Option<&str>, inputs: Vec<Input>) -> Chip {
    Chip { folder: folder.display().to_string(), name: name.map(str::to_owned), inputs }
}

fn input(quantity: usize, channel: &str, zero: f64, gain: f64) -> Input {
    Input { quantity, channel: channel.to_owned(), zero, gain }
}

/// sysfs-interface.rst: millivolt, milliampere, millidegree Celsius.
#[test]
fn channels_are_thousandths_of_volt_ampere_and_degree() {
    let folder = tempfile::tempdir().unwrap();
    let write = |file: &str, text: &str| std::fs::write(folder.path().join(file), text).unwrap();
    // Behind a divider 10:1 and a shunt that is half of what the chip was told.
    let voltage = input(0, "in1", 0.0, 11.0);
    assert!(voltage.measure(folder.path()).unwrap_err().to_string().contains("in1_input"));
    write("in1_input", "2155\n");
    assert!((voltage.measure(folder.path()).unwrap().unwrap() - 23.705).abs() < 1e-12);
    write("curr1_input", "-1500\n");
    assert!((input(1, "curr1", 0.25, 2.0).measure(folder.path()).unwrap().unwrap() + 2.75).abs() < 1e-12);
    write("temp1_input", "-40125\n");
    let temperature = input(2, "temp1", 0.0, 1.0);
    assert!((temperature.measure(folder.path()).unwrap().unwrap() + 40.125).abs() < 1e-12);
    let kelvin = (QUANTITIES[2].measured)(-40.125);
    assert!(matches!(kelvin, Measured::Temperature(kelvin) if (kelvin - 233.025).abs() < 1e-9));
    // "Alarms": a sensor that is at fault measures nothing.
    write("temp1_fault", "1\n");
    assert_eq!(temperature.measure(folder.path()).unwrap(), None);
    write("temp1_fault", "0\n");
    assert!(temperature.measure(folder.path()).unwrap().is_some());
    write("temp1_input", "hot\n");
    assert!(temperature.measure(folder.path()).unwrap_err().to_string().contains("holds no number"));
}

#[test]
fn a_chip_is_found_by_a_folder_that_keeps_its_name_and_refused_under_another() {
    let folder = tempfile::tempdir().unwrap();
    let here = Place::default();
    let above = folder.path().join("1-0040/hwmon");
    let own = above.join("hwmon3");
    std::fs::create_dir_all(&own).unwrap();
    let said = |chip: &Chip| chip.find(&here).unwrap_err().to_string();
    let any = chip(&above, None, Vec::new());
    assert!(said(&any).contains("holds none"), "{}", said(&any));
    std::fs::write(own.join("name"), "ina226\n").unwrap();
    assert_eq!(any.find(&here).unwrap(), own);
    assert_eq!(chip(&own, Some("ina226"), Vec::new()).find(&here).unwrap(), own);
    let other = said(&chip(&above, Some("lm75"), Vec::new()));
    assert!(other.contains("ina226") && other.contains("lm75"), "{other}");
    std::fs::create_dir(above.join("hwmon4")).unwrap();
    std::fs::write(above.join("hwmon4/name"), "lm75\n").unwrap();
    assert!(said(&any).contains("holds 2 chips"), "{}", said(&any));
    assert!(said(&chip(&folder.path().join("none"), None, Vec::new())).contains("cannot read"));
}

#[test]
fn doctor_sees_what_a_chip_measures() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = vec![input(0, "in1", 0.0, 1.0), input(2, "temp1", 0.0, 1.0)];
    let chip = chip(folder.path(), None, inputs);
    let seen = |chip: &Chip| chip.inspect(&Place::default()).unwrap();
    let missing = seen(&chip).unwrap_err();
    assert!(missing.found.contains("holds none") && missing.remedy.contains("modprobe"), "{missing:?}");
    for (file, text) in
        [("name", "ina226"), ("in1_input", "24100"), ("temp1_input", "21500"), ("temp1_fault", "1")]
    {
        std::fs::write(folder.path().join(file), text).unwrap();
    }
    let seen = seen(&chip).unwrap();
    assert!(seen.contains("bus_voltage 24.10 V") && seen.contains("temperature sensor fault"), "{seen}");
}
