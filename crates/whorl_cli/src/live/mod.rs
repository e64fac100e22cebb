//! `whorl live`: the formation in a browser.

mod foxglove;
mod load;
mod server;
mod view;

use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context;
use axum::extract::ws::Utf8Bytes;
use clap::Args;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use tokio::sync::watch;
use whorl_msgs::topics::Topic;
use whorl_params::ParameterTree;
use whorl_report::{PlatformShape, live_html};
use whorl_ros::environment::Network;

use crate::output::{say, tell};
use crate::subscription::Subscription;
use server::{BROWSERS, FOXGLOVE, Server};
use view::View;
use whorl_commands::shapes::shapes;
use whorl_serving::{Door, Places, Site, Visitor, token};

/// Where the page is served unless another port is given.
pub const PORT: u16 = 8470;
/// In the environment: the token of the page, chosen by who started it. Nobody but this user can read it.
pub const TOKEN: &str = "WHORL_LIVE_TOKEN";
/// Time between two frames.
const FRAME: Duration = Duration::from_millis(33);
/// What a page that is opened in mid-run gets first: the last minute, which is what its plots show, with as many frames a second as
/// they have points.
const PAST: usize = 60 * PAST_PER_S;
const PAST_PER_S: usize = 4;
/// Time for answers to who has asked before this page ends.
const LAST_ANSWERS: Duration = Duration::from_secs(2);
/// Silence after which the reason is looked for.
const SILENCE: Duration = Duration::from_secs(5);
const SHARED: [Topic; 2] = [Topic::FormationState, Topic::Diagnostics];
const OF_PLATFORMS: [Topic; 5] = [
    Topic::AttitudeEstimate,
    Topic::AttitudeReference,
    Topic::ControlStatus,
    Topic::ThrusterState,
    Topic::ModelFit,
];

#[derive(Debug, Args)]
pub struct Arguments {
    /// Names of the platforms.
    #[arg(default_values_t = ["whorl_1".to_owned(), "whorl_2".to_owned()], value_name = "PLATFORM")]
    platforms: Vec<String>,
    /// Address to serve the page at; one that is not of this machine alone lets everybody who reaches it watch.
    #[arg(long, default_value = "127.0.0.1", value_name = "ADDRESS")]
    bind: IpAddr,
    /// Port; 0: any free one.
    #[arg(long, default_value_t = PORT)]
    port: u16,
    /// No commands, not even with the token.
    #[arg(long)]
    read_only: bool,
    /// Serves every topic at ws://ADDRESS:PORT/foxglove for Foxglove and Lichtblick, to watch; every page that the browser of
    /// this machine has open can then read along.
    #[arg(long)]
    foxglove: bool,
    /// Run directory whose parameters say what the platforms look like (limits, jets) [default: the files of --params].
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Parameter folder.
    #[arg(long, default_value = "params", value_name = "DIR")]
    params: PathBuf,
}

/// Carries out `whorl live`, until it is stopped.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    whorl_ros::end_with_launcher();
    whorl_ros::limit_memory();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(serve(arguments))
}

async fn serve(arguments: &Arguments) -> anyhow::Result<()> {
    let wanted = SocketAddr::new(arguments.bind, arguments.port);
    let listener = tokio::net::TcpListener::bind(wanted)
        .await
        .with_context(|| format!("cannot serve at {wanted}: --port takes another one, 0 any that is free"))?;
    let address = listener.local_addr()?;
    let network = Network::from_environment()?.secured(whorl_security::policy::MONITOR)?;
    let subscription = Subscription::new(&network, &arguments.platforms, &SHARED, &OF_PLATFORMS)?;
    let token = if arguments.read_only {
        None
    } else {
        Some(token::chosen(TOKEN).map_or_else(token::secret, Ok).context("--read-only needs none")?)
    };
    let (frames, _) = watch::channel(Utf8Bytes::default());
    let past = Past::default();
    let failed = feed(subscription, arguments.platforms.clone(), frames.clone(), Arc::clone(&past))?;

    let looks = Looks::new(arguments);
    let page = Box::new(move || live_html(&looks.shapes()));
    let fragment = token.as_ref().map_or_else(String::new, |token| format!("#token={token}"));
    say!("live at http://{address}/{fragment}");
    if !address.ip().is_loopback() {
        tell(format_args!(
            "warning: everybody who reaches {address} can watch; only who knows the token can command"
        ));
    }
    let foxglove =
        arguments.foxglove.then(|| foxglove::Feed::start(&network, &arguments.platforms)).transpose()?;
    if foxglove.is_some() {
        say!("Foxglove at ws://{address}/foxglove");
    }
    let site = Arc::new(Site { address, token, for_anybody: foxglove.is_some().then_some(FOXGLOVE) });
    let server = Arc::new(Server {
        site,
        page,
        frames,
        past,
        foxglove,
        browsers: Places::new(BROWSERS),
        clients: Places::new(BROWSERS),
    });
    let routes = server::routes(server).into_make_service_with_connect_info::<Visitor>();
    let mut stopped = stop_signal()?;
    let mut told = stopped.clone();
    let serving = axum::serve(Door::new(listener, 0), routes).with_graceful_shutdown(async move {
        let _ = told.wait_for(|stops| *stops).await;
    });
    // An abort ends the run, and the run this page: who asked for it is still answered.
    let last_answers = async {
        let _ = stopped.wait_for(|stops| *stops).await;
        tokio::time::sleep(LAST_ANSWERS).await;
    };
    tokio::select! {
        () = last_answers => Ok(()),
        ended = serving.into_future() => Ok(ended?),
        error = failed => Err(error.unwrap_or_else(|_| anyhow::anyhow!("listening to the formation has ended"))),
    }
}

/// Becomes true with Ctrl-C, or when somebody else ends this process.
fn stop_signal() -> anyhow::Result<watch::Receiver<bool>> {
    let (stop, stopped) = watch::channel(false);
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        for _ in signals.forever() {
            stop.send_replace(true);
        }
    })?;
    Ok(stopped)
}

/// Frames of the last minute, oldest first.
type Past = Arc<Mutex<VecDeque<Utf8Bytes>>>;

/// Listens to the formation in a thread of its own and replaces the frame. The error, if there is one, comes through
/// the channel.
fn feed(
    mut subscription: Subscription,
    platforms: Vec<String>,
    frames: watch::Sender<Utf8Bytes>,
    past: Past,
) -> anyhow::Result<tokio::sync::oneshot::Receiver<anyhow::Error>> {
    let (failed, receiver) = tokio::sync::oneshot::channel();
    std::thread::Builder::new().name("formation".to_owned()).spawn(move || {
        let begun = Instant::now();
        let mut view = View::default();
        let (mut heard, mut hinted) = (false, false);
        let mut kept = 0;
        loop {
            std::thread::sleep(FRAME);
            let now_s = begun.elapsed().as_secs_f64();
            let drained = subscription.drain(|route, message| {
                heard = true;
                view.take(now_s, route, message);
            });
            if let Err(error) = drained {
                let _ = failed.send(error);
                return;
            }
            view.look(now_s);
            if !heard && !hinted && begun.elapsed() > SILENCE {
                hinted = true;
                tell(subscription.hint());
            }
            // Without a browser nothing is written but the past of one that comes.
            let (is_watched, quarter) = (frames.receiver_count() > 0, (now_s * PAST_PER_S as f64) as u64);
            if !is_watched && quarter == kept {
                continue;
            }
            let frame = view.frame(now_s, &platforms);
            let frame: Utf8Bytes = serde_json::to_string(&frame).unwrap_or_default().into();
            if quarter != kept {
                kept = quarter;
                let mut past = past.lock().unwrap_or_else(PoisonError::into_inner);
                past.push_back(frame.clone());
                let many = past.len().saturating_sub(PAST);
                past.drain(..many);
            }
            if is_watched {
                frames.send_replace(frame);
            }
        }
    })?;
    Ok(receiver)
}

/// Where the parameters are that say what platforms look like.
struct Looks {
    platforms: Vec<String>,
    run: Option<PathBuf>,
    params: PathBuf,
}

impl Looks {
    fn new(arguments: &Arguments) -> Self {
        Self {
            platforms: arguments.platforms.clone(),
            run: arguments.run.clone(),
            params: arguments.params.clone(),
        }
    }

    /// Read for every page: the recorder writes a run's parameters only when it has started.
    fn shapes(&self) -> Vec<PlatformShape> {
        self.tree().map_or_else(
            || self.platforms.iter().map(|name| PlatformShape::unknown(name)).collect(),
            |tree| shapes(&tree, &self.platforms),
        )
    }

    fn tree(&self) -> Option<ParameterTree> {
        let of_run = self.run.as_deref().and_then(crate::report::effective_parameters);
        of_run.or_else(|| {
            let names: Vec<&str> = self.platforms.iter().map(String::as_str).collect();
            let files = whorl_params::standard_layers(&self.params, &names, None);
            let there: Vec<PathBuf> = files.into_iter().filter(|f| Path::is_file(f)).collect();
            ParameterTree::load(&there, &[]).ok()
        })
    }
}

/// The port itself, or, for 0, one that is free now.
pub fn free_port(port: u16) -> u16 {
    let free = || std::net::TcpListener::bind((std::net::Ipv4Addr::LOCALHOST, 0))?.local_addr();
    if port == 0 { free().map_or(0, |address| address.port()) } else { port }
}
