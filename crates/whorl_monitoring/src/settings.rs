//! What a monitor is told beside the platform's model.

use whorl_dynamics::PlatformModel;

/// Angular acceleration of a background torque that nobody would miss in a model [rad/s^2]: a tenth of the 5 mN m that a
/// disturbance usually has on a platform of 8.6 kg m^2.
const BACKGROUND_RAD_S2: f64 = 5.8e-5;

/// Systematic error of a whitened reading, over its standard deviation: innovations of a filter whose background torque is there or not
/// correlate with what it corrected by as much (measured: 600 s of holding, wheels, no background torque at all). Twice that hides a jet
/// that was weak from the start.
const SYSTEMATIC: f64 = 0.11;

/// Settings of a monitor.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Readings are averaged over this long \[s\], > 0.
    pub bin_s: f64,
    /// A break of the model is looked for from every multiple of this on \[s\], > 0.
    pub start_every_s: f64,
    /// What broke longer ago than this is for the diagnosis to find \[s\].
    pub memory_s: f64,
    /// An error of the model from the start on is as likely as a break in so long a time, and is looked for as long as the
    /// monitor runs; 0 = breaks only \[s\].
    pub from_start_s: f64,
    /// False alarms in an hour at most, in the mean, > 0.
    pub false_alarms_per_h: f64,
    /// Slow torque that the model need not know, standard deviation about each axis [N m].
    pub background_torque_n_m: f64,
    /// Time over which it forgets itself \[s\], > 0.
    pub background_time_s: f64,
    /// What one pulse of a jet may differ from the next, relative.
    pub pulse_relative_sigma: f64,
    /// What a motor's torque may differ from one moment to the next, relative.
    pub motor_relative_sigma: f64,
    /// White noise of a motor's torque, over its largest torque [sqrt(s)]: what no data sheet states.
    pub motor_noise_sqrt_s: f64,
    /// That noise is learned in the first so many seconds that are watched; 0 = it is what was said \[s\].
    pub motor_noise_learned_s: f64,
    /// Whitened readings may be off by this always, in standard deviations: evidence that such an error explains is none.
    pub systematic_sigma: f64,
    /// Constants of the platform may wander through their prior in this time \[s\], > 0.
    pub constants_time_s: f64,
}

impl Settings {
    /// Those of a platform.
    #[must_use]
    pub fn of(model: &PlatformModel) -> Self {
        let inertia_kg_m2 = model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
        Self {
            bin_s: 0.2,
            start_every_s: 10.0,
            memory_s: 120.0,
            from_start_s: 300.0,
            false_alarms_per_h: 0.1,
            background_torque_n_m: BACKGROUND_RAD_S2 * inertia_kg_m2,
            background_time_s: 20.0,
            pulse_relative_sigma: 0.02,
            motor_relative_sigma: 0.01,
            motor_noise_sqrt_s: 1e-3,
            motor_noise_learned_s: 60.0,
            systematic_sigma: SYSTEMATIC,
            constants_time_s: 3600.0,
        }
    }

    /// Starts in mid-run that are together as likely as the start of all.
    #[must_use]
    pub fn head_start(&self) -> f64 {
        self.from_start_s / self.start_every_s
    }

    /// The evidence that is an alarm \[nats\].
    ///
    /// The sum of likelihood ratios over all starts, less the number of starts, is a martingale while the model is right.
    /// So the mean number of starts before the sum reaches c is at least c (Shiryaev 1963, Roberts 1966; for composite
    /// hypotheses Shin, Ramdas and Rinaldo 2023, theorem 2.4). A head start of r for the first (Shiryaev-Roberts-r: Moustakides,
    /// Polunchenko and Tartakovsky 2011) makes it c - r, and the chance of a false alarm in n starts (n + r) / c at most.
    /// With twice the c, a run at least as long as the head start is worth keeps the rate of one without.
    #[must_use]
    pub fn limit_nats(&self) -> f64 {
        let starts_per_h = 3600.0 / self.start_every_s;
        let twice = if self.from_start_s > 0.0 { 2.0 } else { 1.0 };
        (twice * starts_per_h / self.false_alarms_per_h).max(1.0).ln()
    }
}
