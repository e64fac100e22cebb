//! The thread that receives messages and writes them.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, anyhow, bail};
use whorl_bag::{Manifest, RawSample, RunDescription, RunWriter};
use whorl_node::{Repeats, Timestamp};
use whorl_params::Value;
use whorl_recorder::{Parameters, RecordedTopic, RecorderCore, Status};
use whorl_ros::environment::Network;
use whorl_ros::names::NodeName;
use whorl_ros::recovery::{Action, Recovery, RecoveryTimes};
use whorl_ros::{
    AddressWatch, Announcement, Clock, Continued, EndpointQos, NodeContext, Participant, RawReader, RosError,
    monotonic, wall_clock,
};

/// Polling interval of the readers. Samples carry the time of their arrival, so a long interval costs
/// no accuracy and little processor time.
const LOOK: Duration = Duration::from_millis(10);
/// Queue length per topic, for slow writes to the disk: more than a second of messages.
/// RustDDS always keeps as many in memory.
const DEPTH: u16 = 150;
/// Time between two ticks of the recording, and between two checks of the other participants.
const TICK: Duration = Duration::from_millis(100);
/// Time between two checks of the threads of DDS.
const LIVELINESS: Duration = Duration::from_secs(1);
/// Seconds for which the thread may stand still: a slow disk holds it up for less, and joining the network anew, too. A recorder has been seen
/// to hang without end when a node had been killed; why is not known.
const LONGEST_STILL_S: u32 = 20;
/// The thread's count of its rounds when it has ended them.
const ENDED: u64 = u64::MAX;

/// A recording in progress.
pub struct Recording {
    run_directory: PathBuf,
    status: Arc<Mutex<Status>>,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<anyhow::Result<Manifest>>,
}

impl Recording {
    /// Creates the run directory and starts the thread.
    pub fn start(context: &NodeContext, parameters: &Parameters) -> anyhow::Result<Self> {
        let mut topics = RecordedTopic::all_of(&parameters.platforms);
        topics.extend(parameters.extra_topics.iter().cloned());
        // Before the network is joined, so that no change is missed.
        let addresses = AddressWatch::new(context.network())?;
        let name = context.name().clone();
        let (participant, (readers, announcement)) =
            Participant::with(context.network(), |p| announced(p, &name, &topics))?;
        let run = create_run(context, parameters)?;
        let run_directory = run.path().to_owned();
        recover_earlier_runs(&run_directory)?;
        let core = RecorderCore::new(run, topics)?;
        let status = Arc::new(Mutex::new(core.status()));
        let stop = Arc::new(AtomicBool::new(false));
        let rounds = Arc::new(AtomicU64::new(0));
        let worker = Worker {
            rounds: Arc::clone(&rounds),
            participant,
            readers,
            name,
            announcement,
            core,
            status: Arc::clone(&status),
            stop: Arc::clone(&stop),
            recovery: Recovery::new(RecoveryTimes::default()),
            clock: Clock::default(),
            continued: Continued::watch()?,
            addresses,
            next_liveliness: monotonic() + LIVELINESS,
            unreadable: Repeats::default(),
            notes: Vec::new(),
        };
        let thread = std::thread::Builder::new()
            .name("recording".to_owned())
            .spawn(move || worker.run())
            .context("cannot start the recording thread")?;
        watch(rounds, run_directory.clone())?;
        Ok(Self { run_directory, status, stop, thread })
    }

    pub fn run_directory(&self) -> &Path {
        &self.run_directory
    }

    /// The current status.
    pub fn status(&self) -> impl FnMut() -> Status + Send + use<> {
        let status = Arc::clone(&self.status);
        move || status.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Stops the thread and closes the run directory. An error when the recording is not complete.
    pub fn finish(self) -> anyhow::Result<()> {
        self.stop.store(true, Ordering::Relaxed);
        let manifest = self.thread.join().map_err(|_| anyhow!("the recording thread died"))??;
        let status = self.status.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reason) = &status.stopped_by {
            bail!("the recording in {} is not complete: {reason}", self.run_directory.display());
        }
        tracing::info!(
            "recorded {} messages in {:.1} s, {} lost: {}",
            manifest.message_count(),
            manifest.duration_s(),
            manifest.lost(),
            self.run_directory.display()
        );
        Ok(())
    }
}

fn readers(participant: &Participant, topics: &[RecordedTopic]) -> Result<Vec<RawReader>, RosError> {
    let reader = |topic: &RecordedTopic| {
        let qos = EndpointQos { depth: DEPTH, ..EndpointQos::from(topic.qos) };
        participant.reader(&topic.name, &topic.type_name, qos)
    };
    topics.iter().map(reader).collect()
}

/// The readers, announced as the node's.
fn announced(
    participant: &Participant,
    node: &NodeName,
    topics: &[RecordedTopic],
) -> Result<(Vec<RawReader>, Announcement), RosError> {
    let readers = readers(participant, topics)?;
    let announcement = Announcement::new(participant, node, "bag", readers.iter().map(RawReader::id))?;
    Ok((readers, announcement))
}

/// The run directory with the parameter files, and all nodes' parameters after layering.
fn create_run(context: &NodeContext, parameters: &Parameters) -> anyhow::Result<RunWriter> {
    let coordinators = || match context.tree().for_node("/coordinator").get("experiment.name")?.value {
        Value::String(ref name) => Some(name.clone()),
        _ => None,
    };
    let description = RunDescription {
        experiment: parameters
            .experiment
            .clone()
            .or_else(coordinators)
            .unwrap_or_else(|| "recording".to_owned()),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        git_commit: parameters.git_commit.clone(),
        seed: parameters.seed,
        simulated_time: false,
        platforms: parameters.platforms.clone(),
        notes: context.network().enclave.iter().map(|_| RunDescription::secured_note()).collect(),
    };
    let (now, bag) = (wall_clock(), parameters.bag);
    let mut run = match &parameters.run_directory {
        Some(directory) => RunWriter::create_in(directory, description, now, bag)?,
        None => RunWriter::create(&parameters.out_directory, description, now, bag)?,
    };
    run.add_parameter_files(&context.arguments().parameter_files)?;
    let effective = context.tree().effective_yaml();
    run.add_parameters("effective.yaml", "all files and -p arguments of the recorder", effective.as_bytes())?;
    Ok(run)
}

/// Completes runs in the same folder whose recorder was killed. Runs in its own thread, which may take as
/// long as it needs: it changes only files of earlier runs.
fn recover_earlier_runs(run_directory: &Path) -> anyhow::Result<()> {
    let Some(runs) = run_directory.parent().map(Path::to_owned) else { return Ok(()) };
    let recover = move || {
        for (run, result) in whorl_bag::recover_runs(&runs) {
            match result {
                Ok(recovery) => {
                    tracing::info!("made {} complete: {} messages", run.display(), recovery.messages);
                }
                Err(error) => tracing::warn!("cannot make {} complete: {error}", run.display()),
            }
        }
    };
    std::thread::Builder::new()
        .name("recovering".to_owned())
        .spawn(recover)
        .context("cannot start the recovering thread")?;
    Ok(())
}

/// Ends the program when the recording thread stands still: a recorder that waits for ever looks like one that records.
fn watch(rounds: Arc<AtomicU64>, run_directory: PathBuf) -> anyhow::Result<()> {
    let watch = move || {
        let (mut last, mut still_s) = (0, 0);
        // Looks are counted, not seconds: a program that was stopped and continued has not stood still.
        while still_s < LONGEST_STILL_S {
            std::thread::sleep(Duration::from_secs(1));
            let now = rounds.load(Ordering::Relaxed);
            if now == ENDED {
                return;
            }
            still_s = if now == last { still_s + 1 } else { 0 };
            last = now;
        }
        let _ = writeln!(
            std::io::stderr(),
            "recorder: the recording in {} is not complete: its thread has stood still for {LONGEST_STILL_S} s, waiting for the disk or the DDS library",
            run_directory.display()
        );
        std::process::exit(1);
    };
    std::thread::Builder::new()
        .name("watching".to_owned())
        .spawn(watch)
        .context("cannot start the thread that watches the recording")?;
    Ok(())
}

struct Worker {
    /// How often it has looked for messages.
    rounds: Arc<AtomicU64>,
    participant: Participant,
    readers: Vec<RawReader>,
    name: NodeName,
    announcement: Announcement,
    core: RecorderCore<RunWriter>,
    status: Arc<Mutex<Status>>,
    stop: Arc<AtomicBool>,
    recovery: Recovery,
    /// Log times are its: they must not go back when the computer's clock is set.
    clock: Clock,
    continued: Continued,
    addresses: Option<AddressWatch>,
    next_liveliness: Duration,
    unreadable: Repeats,
    /// For the manifest.
    notes: Vec<(&'static str, String)>,
}

impl Worker {
    fn run(mut self) -> anyhow::Result<Manifest> {
        let mut next_tick = monotonic();
        loop {
            let stopping = self.stop.load(Ordering::Relaxed);
            self.rounds.fetch_add(1, Ordering::Relaxed);
            self.take();
            let now = monotonic();
            if now >= next_tick || stopping {
                next_tick = now + TICK;
                self.core.tick(self.clock.now());
                self.look_after_connection(now);
                *self.status.lock().unwrap_or_else(PoisonError::into_inner) = self.core.status();
                self.look_after_peers(now);
            }
            if stopping {
                break;
            }
            std::thread::sleep(LOOK);
        }
        // Closing a large bag may take its time.
        self.rounds.store(ENDED, Ordering::Relaxed);
        let mut run = self.core.finish();
        for (key, text) in self.notes {
            run.note(key, text);
        }
        Ok(run.finish(wall_clock())?)
    }

    /// Joins the network anew when the connection has become useless: readers would be silent for ever, without an error.
    fn look_after_connection(&mut self, now: Duration) {
        let (mut reason, mut network) = (None, None);
        if self.continued.take() {
            reason = Some(("interrupted", "the recorder was stopped and continued".to_owned()));
        }
        if let Some(step) = self.clock.take_step() {
            tracing::warn!("{step}: times in the recording go on steadily, stamps in messages do not");
            self.notes.push(("clock_set", format!("{} at {}", step, self.clock.now())));
            if step.needs_rejoining() {
                reason = Some(("interrupted", "the clock was set back".to_owned()));
            }
        }
        match self.addresses.as_mut().map(|addresses| addresses.changed(now)) {
            Some(Ok(Some(new))) => {
                reason =
                    Some(("addresses_changed", "the addresses of this computer have changed".to_owned()));
                network = Some(new);
            }
            Some(Err(error)) => {
                tracing::error!(
                    "the addresses of this computer have changed: nothing can be received: {error}"
                );
            }
            Some(Ok(None)) | None => {}
        }
        if now >= self.next_liveliness {
            self.next_liveliness = now + LIVELINESS;
            if reason.is_none() && !self.participant.is_alive() {
                reason = Some(("interrupted", "the threads of DDS had ended".to_owned()));
            }
        }
        let Some((key, text)) = reason else { return };
        tracing::warn!("{text}: rejoining the network; what is sent meanwhile is not recorded");
        let topics: Vec<RecordedTopic> = self.core.topics().cloned().collect();
        match self.rejoin_on(network, &topics) {
            Ok(()) => self.notes.push((key, format!("{text}, at {}", self.clock.now()))),
            // The next check of the threads tries again.
            Err(error) => tracing::error!("cannot join the network, nothing is recorded: {error:#}"),
        }
    }

    fn rejoin(&mut self, topics: &[RecordedTopic]) -> Result<(), RosError> {
        self.rejoin_on(None, topics)
    }

    /// On another network than before, if one is given.
    fn rejoin_on(&mut self, network: Option<Network>, topics: &[RecordedTopic]) -> Result<(), RosError> {
        let network = network.unwrap_or_else(|| self.participant.network().clone());
        (self.participant, (self.readers, self.announcement)) =
            Participant::with(&network, |p| announced(p, &self.name, topics))?;
        self.recovery = Recovery::new(RecoveryTimes::default());
        Ok(())
    }

    fn take(&mut self) {
        for (topic, reader) in self.readers.iter().enumerate() {
            reader.drain_notifications();
            loop {
                match reader.take() {
                    Ok(Some(sample)) => {
                        let log_time = self.clock.own_time(sample.receive_time);
                        self.core.sample(
                            topic,
                            RawSample {
                                log_time,
                                publish_time: plausible(sample.source_time).unwrap_or(log_time),
                                origin: Some((
                                    u128::from_be_bytes(sample.writer.0),
                                    u64::try_from(sample.sequence_number).unwrap_or(0),
                                )),
                                cdr: &sample.bytes,
                            },
                        );
                    }
                    Ok(None) => break,
                    Err(error) => {
                        let text = self.unreadable.admit(self.clock.now(), || error.to_string());
                        text.iter().for_each(|text| tracing::warn!("{text}"));
                        break;
                    }
                }
            }
        }
    }

    fn renew(&mut self, topics: &[RecordedTopic]) -> Result<(), RosError> {
        match announced(&self.participant, &self.name, topics) {
            Err(RosError::Stuck { .. }) => self.rejoin(topics)?,
            other => (self.readers, self.announcement) = other?,
        }
        Ok(())
    }

    /// After a cut of the network RustDDS needs new readers; see [`whorl_ros::recovery`]. What arrives until
    /// they have found their writers again is lost and counted.
    fn look_after_peers(&mut self, now: Duration) {
        while let Some(event) = self.participant.peer_event() {
            self.recovery.peer(now, event);
        }
        if let Some(Action::Renew(_)) = self.recovery.act(now, None) {
            let topics: Vec<RecordedTopic> = self.core.topics().cloned().collect();
            if let Err(error) = self.renew(&topics) {
                tracing::warn!("cannot renew the readers: {error:#}");
            }
        }
    }
}

/// Bag times count from 1970; a writer without a clock may send other values.
fn plausible(time: Option<Timestamp>) -> Option<Timestamp> {
    time.filter(|time| time.0 > 0)
}
