//! The event loop of a node: one thread that moves messages, time and parameters.

use std::io::Read as _;
use std::os::fd::AsRawFd;
use std::time::Duration;

use mio::net::UnixStream;
use mio::unix::SourceFd;
use mio::{Events, Interest, Poll, Token};
use whorl_msgs::{Route, Topic};
use whorl_node::{Configurable, Event, LogLevel, NodeCore};

use crate::addresses::AddressWatch;
use crate::clock::{Schedule, monotonic};
use crate::connection::{Connection, Notice};
use crate::context::NodeContext;
use crate::endpoints::{Plan, Readable};
use crate::error::RosError;
use crate::memory;
use crate::parameters::ParameterSet;
use crate::recovery::Reason;
use crate::shell::{Read, Shell};
use crate::wake::{self, Alarm, Signals};
use crate::watchdog::Watchdog;

const SIGNALS: Token = Token(0);
const ALARM: Token = Token(1);
const CONTINUED: Token = Token(2);
const WOKEN: Token = Token(3);
const ADDRESSES: Token = Token(4);

/// How often the shell checks peers and diagnostics; and while endpoints are being renewed.
const HOUSEKEEPING: Duration = Duration::from_millis(100);
const HOUSEKEEPING_WHILE_RENEWING: Duration = Duration::from_millis(10);
/// How often the shell checks for silent subscriptions, which needs a copy of the discovery data.
const SILENCE_CHECK: Duration = Duration::from_secs(5);
const DIAGNOSTICS: Duration = Duration::from_secs(1);
/// Why a connection is rebuilt after the process was stopped and continued.
const INTERRUPTED: &str = "the background threads of DDS had been interrupted";
/// Why, after they have stopped for good, each waiting for the other.
const LOCKED_UP: &str = "the background threads of DDS had locked up";

/// Why, after its addresses changed.
const READDRESSED: &str = "the addresses of this computer have changed";

/// A core with everything around it.
pub(crate) struct Runner<C: Configurable> {
    shell: Shell<C>,
    connection: Connection,
    schedule: Option<Schedule>,
    period: Duration,
    poll: Poll,
    alarm: Alarm,
    signals: Signals,
    continued: Signals,
    wakers: Vec<UnixStream>,
    addresses: Option<AddressWatch>,
    watchdog: Watchdog,
}

impl<C: Configurable> Runner<C> {
    pub(crate) fn new(
        context: &NodeContext,
        core: C,
        parameters: ParameterSet,
        read: Read<C::Parameters>,
    ) -> Result<Self, RosError> {
        let plan = plan(context, &core)?;
        let poll = Poll::new().map_err(RosError::io("creating an event loop"))?;
        let alarm = Alarm::new(poll.registry(), ALARM)?;
        // Before the network is joined: from here on a signal is answered in order.
        let signals = Signals::new(poll.registry(), SIGNALS, wake::END)?;
        let continued = Signals::new(poll.registry(), CONTINUED, wake::CONTINUE)?;
        let mut wakers: Vec<UnixStream> =
            context.take_wakers().into_iter().map(UnixStream::from_std).collect();
        for waker in &mut wakers {
            poll.registry()
                .register(waker, WOKEN, Interest::READABLE)
                .map_err(RosError::io("watching what the node drives"))?;
        }
        // Before the network is joined, so that no change is missed.
        let addresses = AddressWatch::new(context.network())?;
        if let Some(addresses) = &addresses {
            poll.registry()
                .register(&mut SourceFd(&addresses.as_raw_fd()), ADDRESSES, Interest::READABLE)
                .map_err(RosError::io("watching the addresses of this computer"))?;
        }
        let shell = Shell::new(context.name().clone(), context.clock(), core, &plan, parameters, read);
        // After everything that a node loads at the start, recordings among it, and before anybody can send it anything.
        memory::lock_memory();
        memory::limit_memory();
        let connection = Connection::new(context.network(), plan, poll.registry())?;
        let period = shell.timer_period().unwrap_or_default();
        let schedule = Schedule::new(monotonic(), period);
        let watchdog = Watchdog::start(context.name().full())?;
        Ok(Self {
            shell,
            connection,
            schedule,
            period,
            poll,
            alarm,
            signals,
            continued,
            wakers,
            addresses,
            watchdog,
        })
    }

    /// Runs until the core has finished or a signal comes.
    pub(crate) fn run(mut self) -> Result<(), RosError> {
        let network = if self.connection.is_localhost() {
            "this machine only (ROS_AUTOMATIC_DISCOVERY_RANGE is not SUBNET)"
        } else {
            "the network"
        };
        self.shell.say(
            &self.connection,
            LogLevel::Info,
            format!("started in domain {} on {network}", self.connection.domain_id()),
        );
        let mut events = Events::with_capacity(64);
        let mut housekeeping = monotonic();
        let mut diagnostics = housekeeping + DIAGNOSTICS;
        let mut silence_check = housekeeping + SILENCE_CHECK;
        let mut silence = None;
        while !self.shell.stop {
            self.watchdog.turn();
            let next_firing = self.schedule.map_or(housekeeping, |s| s.next().min(housekeeping));
            self.alarm.set(next_firing)?;
            match self.poll.poll(&mut events, None) {
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
                other => other.map_err(RosError::io("waiting for events"))?,
            }
            for event in &events {
                match event.token() {
                    SIGNALS if self.signals.received() => self.shell.stop = true,
                    CONTINUED if self.continued.received() => self.rebuild_connection(INTERRUPTED)?,
                    WOKEN => self.woken(),
                    // Looked at in time with the other housekeeping.
                    ADDRESSES => {}
                    token => self.readable(token),
                }
            }
            self.fire_timer();
            let now = monotonic();
            match self.connection.release_answers(now) {
                Ok(true) => housekeeping = housekeeping.min(now + HOUSEKEEPING_WHILE_RENEWING),
                Ok(false) => {}
                Err(error) => {
                    let text = format!("a request could not be answered: {error}");
                    self.shell.say(&self.connection, LogLevel::Warn, text);
                }
            }
            if now < housekeeping {
                continue;
            }
            self.look_at_the_clock()?;
            self.look_at_the_addresses(now)?;
            if now >= silence_check {
                silence_check = now + SILENCE_CHECK;
                silence = self.longest_silence(now);
            }
            self.look_after_connection(now, silence)?;
            if now >= diagnostics {
                diagnostics = now + DIAGNOSTICS;
                if !self.connection.is_alive() {
                    let why = if self.connection.is_stuck() { LOCKED_UP } else { INTERRUPTED };
                    self.rebuild_connection(why)?;
                }
                self.shell.report(&self.connection);
            }
            housekeeping =
                now + if self.connection.is_renewing() { HOUSEKEEPING_WHILE_RENEWING } else { HOUSEKEEPING };
        }
        // What follows has limits of its own.
        self.watchdog.waits(true);
        self.shell.step(&self.connection, Event::Shutdown);
        self.shell.say(&self.connection, LogLevel::Info, "stopped".to_owned());
        let failure = self.shell.core.failure();
        self.connection.close()?;
        failure.map_or(Ok(()), |reason| Err(RosError::Failed { reason }))
    }

    fn fire_timer(&mut self) {
        let Some(schedule) = &mut self.schedule else { return };
        let now = monotonic();
        let due = schedule.next();
        // One at a time, so that messages which came meanwhile are not kept waiting when many
        // firings are owed.
        if schedule.fire(now) {
            if now - due > self.period {
                self.shell.statistics.late_timers += 1;
            }
            self.shell.step(&self.connection, Event::Timer);
        }
    }

    fn woken(&mut self) {
        let mut buffer = [0; 256];
        for waker in &mut self.wakers {
            while matches!(waker.read(&mut buffer), Ok(1..)) {}
        }
        self.shell.step(&self.connection, Event::Woken);
    }

    fn readable(&mut self, token: Token) {
        let Some((generation, what)) = self.connection.at(token) else { return };
        match what {
            Readable::Subscription(index) => self.shell.take_messages(&self.connection, generation, index),
            Readable::Service(index) => self.shell.serve(&self.connection, generation, index),
            Readable::Parameter(index) => self.shell.serve_parameters(&self.connection, generation, index),
        }
    }

    /// Says that the computer's clock was set; the node's own time has not changed.
    fn look_at_the_clock(&mut self) -> Result<(), RosError> {
        self.shell.clock.now();
        let Some(step) = self.shell.clock.take_step() else { return Ok(()) };
        self.shell.statistics.clock_steps += 1;
        let text = format!("{step}: stamps follow, deadlines do not");
        self.shell.say(&self.connection, LogLevel::Warn, text);
        if step.needs_rejoining() { self.rebuild_connection("the clock was set back") } else { Ok(()) }
    }

    /// Joins the network with the computer's new addresses, if they have changed.
    fn look_at_the_addresses(&mut self, now: Duration) -> Result<(), RosError> {
        let Some(addresses) = &mut self.addresses else { return Ok(()) };
        match addresses.changed(now) {
            Ok(None) => Ok(()),
            Ok(Some(network)) => {
                self.shell.step(&self.connection, Event::Interruption);
                self.watchdog.waits(true);
                self.connection = self.connection.rebuilt_on(&network, self.poll.registry())?;
                self.watchdog.waits(false);
                self.rejoined(READDRESSED);
                Ok(())
            }
            Err(error) => {
                let text = format!("{READDRESSED}, and it cannot be reached: {error}");
                self.shell.say(&self.connection, LogLevel::Error, text);
                Ok(())
            }
        }
    }

    fn rebuild_connection(&mut self, reason: &str) -> Result<(), RosError> {
        // Joining takes from a tenth of a second to several, in which nothing is watched.
        self.shell.step(&self.connection, Event::Interruption);
        self.watchdog.waits(true);
        self.connection = self.connection.rebuilt(self.poll.registry())?;
        self.watchdog.waits(false);
        self.rejoined(reason);
        Ok(())
    }

    fn rejoined(&mut self, reason: &str) {
        self.shell.statistics.reconnections += 1;
        self.shell.say(&self.connection, LogLevel::Warn, format!("{reason}: rejoined the network"));
    }

    fn look_after_connection(&mut self, now: Duration, silence: Option<Duration>) -> Result<(), RosError> {
        let notice = match self.connection.look_after(now, silence, self.poll.registry()) {
            Err(error @ RosError::Stuck { .. }) => return self.rebuild_connection(&error.to_string()),
            other => other?,
        };
        self.shell.writers_gone(now, self.connection.take_lost_writers());
        self.shell.statistics.missing_participants = self.connection.recovery().missing();
        self.shell.statistics.renewals = self.connection.recovery().renewals();
        let missing = self.connection.recovery().missing();
        let (level, text) = match notice {
            None => return Ok(()),
            Some(Notice::Missing) => {
                (LogLevel::Warn, format!("{missing} participant(s) silent for longer than their lease"))
            }
            Some(Notice::Renewing(Reason::PeerReturned)) => {
                (LogLevel::Info, "a participant is back: renewing the endpoints".to_owned())
            }
            Some(Notice::Renewing(Reason::Silence)) => (
                LogLevel::Warn,
                "a subscription is silent though its writer is known: renewing the endpoints".to_owned(),
            ),
            Some(Notice::Renewed) => (LogLevel::Info, "endpoints renewed".to_owned()),
        };
        self.shell.say(&self.connection, level, text);
        Ok(())
    }

    /// The longest silence of the subscriptions which once delivered and whose writer is known.
    fn longest_silence(&self, now: Duration) -> Option<Duration> {
        let silent: Vec<_> = self
            .shell
            .statistics
            .subscriptions
            .iter()
            .filter_map(|(_, counts)| Some((counts, now.saturating_sub(counts.last?))))
            .filter(|(_, silence)| *silence > SILENCE_CHECK)
            .collect();
        if silent.is_empty() {
            return None;
        }
        let known = self.connection.known_writers();
        silent
            .into_iter()
            .filter(|(counts, _)| counts.writers().any(|writer| known.contains(writer)))
            .map(|(_, silence)| silence)
            .max()
    }
}

/// Endpoints of the core, with the names set on the command line.
fn plan<C: NodeCore>(context: &NodeContext, core: &C) -> Result<Plan, RosError> {
    let node = context.name();
    let remapped = |name: String| {
        let resolved = node.resolve(&name);
        let remap = context.arguments().remaps.iter().find(|r| node.resolve(&r.from) == resolved);
        remap.map_or(resolved, |r| node.resolve(&r.to))
    };
    let named = |routes: Vec<Route>| {
        let mut list: Vec<(Route, String)> = Vec::new();
        for route in routes {
            if list.iter().any(|(r, _)| *r == route) {
                continue;
            }
            let name = route.name(context.platforms()).ok_or(RosError::Platform {
                index: route.platform.map_or(0, |p| p.0),
                count: context.platforms().len(),
            })?;
            list.push((route, remapped(name)));
        }
        Ok::<_, RosError>(list)
    };
    let mut publications = core.publications();
    publications.push(Route::shared(Topic::Diagnostics));
    Ok(Plan {
        node: node.clone(),
        subscriptions: named(core.subscriptions())?,
        publications: named(publications)?,
        services: core.services().iter().map(|s| (*s, remapped(s.name().to_owned()))).collect(),
        rosout: context.arguments().rosout,
    })
}
