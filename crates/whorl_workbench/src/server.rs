//! The web server: the page, what it is made of, and the interface. Everything but the page needs the token.

use std::net::SocketAddr;
use std::path::Path as FilePath;
use std::sync::Arc;

use axum::Router;
use axum::body::Bytes;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{ConnectInfo, DefaultBodyLimit, Path, Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use serde::Serialize;
use serde::de::DeserializeOwned;
use whorl_commands::in_words;
use whorl_dynamics::effects::catalogue;
use whorl_serving::{FRAMES, Places, Site, Visitor, same_site, states};

use crate::api::{
    Ask, AskAnswer, AskSeries, Choice, EffectRow, FileKind, SetChannel, SetParameter, Stretch, TextFile,
};
use crate::assets;
use crate::bench::Workbench;
use crate::export::export;
use crate::project::inside;
use crate::work;

/// Pages that are open at the same time.
const PAGES: usize = 16;
/// Largest file that may be dropped on the page.
pub const LARGEST_FILE: usize = 256 << 20;
/// A file's name, as JSON writes it in ASCII.
const NAME: &str = "x-name";
/// Scripts, styles and numbers of this server; nothing else may be loaded or called.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

struct Server {
    bench: Arc<Workbench>,
    pages: Arc<Places>,
}

/// What of it a handler gets, and what it says.
type Shared = State<Arc<Server>>;
type Answered = Result<Response, Refused>;

/// Why not, in words.
struct Refused(StatusCode, String);

impl IntoResponse for Refused {
    fn into_response(self) -> Response {
        (self.0, self.1).into_response()
    }
}

impl From<anyhow::Error> for Refused {
    fn from(error: anyhow::Error) -> Self {
        Self(StatusCode::CONFLICT, in_words(&error))
    }
}

/// The routes of a workbench at an address, for who knows the token.
pub fn routes(bench: Arc<Workbench>, address: SocketAddr, token: String) -> Router {
    let site = Arc::new(Site { address, token: Some(token), for_anybody: None });
    let server = Arc::new(Server { bench, pages: Places::new(PAGES) });
    let interface = Router::new()
        .route("/states", get(all_states))
        .route("/state", post(state))
        .route("/ask", post(ask))
        .route("/answer", post(answer))
        .route("/series", post(series))
        .route("/stop", post(stop))
        .route("/clear", post(clear))
        .route("/choose", post(choose))
        .route("/file", post(file))
        .route("/example", post(example))
        .route("/text", post(text))
        .route("/write", post(write))
        .route("/platform", post(platform))
        .route("/set", post(set))
        .route("/undo", post(undo))
        .route("/map", post(map))
        .route("/set_channel", post(set_channel))
        .route("/stretch", post(stretch))
        .route("/effects", post(effects))
        .route("/export", post(exported))
        .layer(middleware::from_fn_with_state(Arc::clone(&site), known_only));
    Router::new()
        .route("/", get(page))
        .route("/assets/{name}", get(asset))
        .nest("/api", interface)
        .layer(DefaultBodyLimit::max(LARGEST_FILE))
        .layer(middleware::from_fn_with_state(site, same_site))
        .with_state(server)
}

async fn known_only(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    if !site.knows(request.headers()) {
        let why = "this page needs the address that whorl open printed, with its token\n";
        return (StatusCode::UNAUTHORIZED, why).into_response();
    }
    next.run(request).await
}

async fn page() -> Response {
    ([(CONTENT_SECURITY_POLICY, POLICY), (CACHE_CONTROL, "no-store")], Html(assets::PAGE)).into_response()
}

async fn asset(Path(name): Path<String>) -> Response {
    match assets::find(&name) {
        Some((kind, content)) => {
            ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-cache")], content).into_response()
        }
        None => (StatusCode::NOT_FOUND, "there is no such part of the page\n").into_response(),
    }
}

async fn all_states(
    State(server): Shared,
    ConnectInfo(visitor): ConnectInfo<Visitor>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let Some(place) = server.pages.take(true) else {
        return (StatusCode::SERVICE_UNAVAILABLE, format!("{PAGES} pages are open already\n"))
            .into_response();
    };
    let receiver = server.bench.states();
    let now = as_text(&server.bench.state());
    upgrade.protocols([FRAMES]).on_upgrade(move |socket| {
        visitor.upgraded();
        states(socket, vec![now.into()], receiver, place)
    })
}

fn as_text<T: Serialize>(value: &T) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

fn json<T: Serialize>(value: &T) -> Response {
    ([(CONTENT_TYPE, "application/json"), (CACHE_CONTROL, "no-store")], as_text(value)).into_response()
}

fn read<T: DeserializeOwned>(body: &Bytes) -> Result<T, Refused> {
    serde_json::from_slice(body)
        .map_err(|error| Refused(StatusCode::BAD_REQUEST, format!("the request cannot be read: {error}")))
}

/// What reads or writes files, away from the thread that serves.
async fn apart<T: Send + 'static>(
    work: impl FnOnce() -> anyhow::Result<T> + Send + 'static,
) -> Result<T, Refused> {
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => Ok(result?),
        Err(error) => Err(Refused(StatusCode::INTERNAL_SERVER_ERROR, error.to_string())),
    }
}

async fn state(State(server): Shared) -> Response {
    json(&server.bench.state())
}

async fn ask(State(server): Shared, body: Bytes) -> Answered {
    let ask: Ask = read(&body)?;
    server.bench.ask(ask)?;
    Ok(json(&server.bench.state()))
}

async fn answer(State(server): Shared, body: Bytes) -> Answered {
    let asked: AskAnswer = read(&body)?;
    let bench = Arc::clone(&server.bench);
    let answer = apart(move || Ok(bench.answer(&asked.of, asked.number))).await?;
    Ok(json(&answer))
}

async fn series(State(server): Shared, body: Bytes) -> Answered {
    let asked: AskSeries = read(&body)?;
    let bench = Arc::clone(&server.bench);
    let numbers = apart(move || Ok(bench.columns(&asked.file).map(|columns| columns.answer(&asked)))).await?;
    match numbers {
        Some(numbers) => {
            Ok(([(CONTENT_TYPE, "application/octet-stream"), (CACHE_CONTROL, "no-store")], numbers)
                .into_response())
        }
        None => Err(Refused(StatusCode::NOT_FOUND, "this recording has not been read yet".to_owned())),
    }
}

async fn stop(State(server): Shared, body: Bytes) -> Answered {
    server.bench.stop(read(&body)?);
    Ok(json(&server.bench.state()))
}

async fn clear(State(server): Shared) -> Response {
    server.bench.clear();
    json(&server.bench.state())
}

async fn choose(State(server): Shared, body: Bytes) -> Answered {
    let choice: Choice = read(&body)?;
    let bench = Arc::clone(&server.bench);
    apart(move || bench.choose(choice)).await?;
    Ok(json(&server.bench.state()))
}

/// A file that was dropped on the page comes into the folder; nothing that is there is replaced.
async fn file(State(server): Shared, headers: HeaderMap, body: Bytes) -> Answered {
    let name = headers.get(NAME).and_then(|name| serde_json::from_slice::<String>(name.as_bytes()).ok());
    let Some(name) = name else {
        return Err(Refused(StatusCode::BAD_REQUEST, format!("the file has no name ({NAME})")));
    };
    let bench = Arc::clone(&server.bench);
    apart(move || {
        let path = inside(bench.folder(), &name)?;
        let is_new = put(&path, &body)?;
        // Of a bag's folder the folder is the recording.
        let shown = FilePath::new(&name)
            .parent()
            .filter(|folder| bench.folder().join(folder).join("metadata.yaml").is_file());
        let is_bag = shown.is_some();
        let shown = shown.map_or(name.clone(), |folder| folder.display().to_string());
        // The files of a bag come one by one; its metadata may be the last.
        let may_be_bag = is_bag || FilePath::new(&name).components().count() > 1;
        if !bench.arrived(&shown) && !may_be_bag {
            if is_new {
                std::fs::remove_file(&path)?;
            }
            anyhow::bail!("{name} is no recording (.csv, .csv.gz, .mcap, .db3, a bag's folder), no platform's file and no map; it was not kept");
        }
        Ok(())
    })
    .await?;
    Ok(json(&server.bench.state()))
}

async fn example(State(server): Shared) -> Answered {
    let bench = Arc::clone(&server.bench);
    apart(move || {
        for (name, content) in assets::EXAMPLE {
            put(&inside(bench.folder(), name)?, content)?;
        }
        bench.look();
        bench.choose(assets::example_choice())?;
        bench.ask(Ask::Compare)
    })
    .await?;
    Ok(json(&server.bench.state()))
}

/// Whether it was not there yet.
fn put(path: &FilePath, body: &[u8]) -> anyhow::Result<bool> {
    if path.exists() {
        if std::fs::read(path).is_ok_and(|there| there == body) {
            return Ok(false);
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        anyhow::bail!("{name} is there already, with another content: rename one of them");
    }
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent)?;
    }
    whorl_files::write_file(path, body)?;
    Ok(true)
}

async fn text(State(server): Shared, body: Bytes) -> Answered {
    let asked: TextFile = read(&body)?;
    let bench = Arc::clone(&server.bench);
    let text = apart(move || {
        let path = bench
            .listed(&asked.file, FileKind::Model)
            .or_else(|_| bench.listed(&asked.file, FileKind::Map))?;
        Ok(TextFile { text: whorl_files::read_text(&path)?, file: asked.file })
    })
    .await?;
    Ok(json(&text))
}

async fn write(State(server): Shared, body: Bytes) -> Answered {
    let wanted: TextFile = read(&body)?;
    let bench = Arc::clone(&server.bench);
    let change = apart(move || {
        let change = work::set_text(&bench, &wanted.file, &wanted.text)?;
        bench.did("write", format!("{}: written.", wanted.file));
        Ok(change)
    })
    .await?;
    Ok(json(&change))
}

async fn platform(State(server): Shared) -> Answered {
    let bench = Arc::clone(&server.bench);
    Ok(json(&apart(move || work::platform(&bench)).await?))
}

async fn set(State(server): Shared, body: Bytes) -> Answered {
    let wanted: SetParameter = read(&body)?;
    let bench = Arc::clone(&server.bench);
    let change = apart(move || {
        let change = work::set_parameter(&bench, &wanted.key, &wanted.value)?;
        bench.did(
            "set",
            format!("{} = {}: written as a step of the model's history.", wanted.key, wanted.value),
        );
        Ok(change)
    })
    .await?;
    Ok(json(&change))
}

async fn undo(State(server): Shared) -> Answered {
    let bench = Arc::clone(&server.bench);
    let change = apart(move || {
        let (change, said) = work::undo(&bench)?;
        bench.did("undo", said);
        Ok(change)
    })
    .await?;
    Ok(json(&change))
}

async fn map(State(server): Shared) -> Answered {
    let bench = Arc::clone(&server.bench);
    Ok(json(&apart(move || work::map(&bench)).await?))
}

async fn set_channel(State(server): Shared, body: Bytes) -> Answered {
    let wanted: SetChannel = read(&body)?;
    let bench = Arc::clone(&server.bench);
    let change = apart(move || {
        let change = work::set_channel(&bench, &wanted)?;
        bench.did("write", format!("{}: written into the map.", wanted.key));
        Ok(change)
    })
    .await?;
    Ok(json(&change))
}

async fn stretch(State(server): Shared, body: Bytes) -> Answered {
    let asked: Stretch = read(&body)?;
    let bench = Arc::clone(&server.bench);
    apart(move || {
        let name = work::stretch(&bench, &asked)?;
        bench.did("stretch", format!("{name}: written, and used in place of {}.", asked.file));
        bench.choose(work::with_stretch(bench.choice(), &asked, &name))
    })
    .await?;
    Ok(json(&server.bench.state()))
}

async fn effects() -> Response {
    let row = |effect: &'static dyn whorl_dynamics::effects::Effect| {
        let info = effect.info();
        EffectRow {
            id: info.id.to_owned(),
            title: info.title.to_owned(),
            explanation: info.explanation.to_owned(),
            equation: info.equation.to_owned(),
            source: info.source.to_owned(),
            separated_by: info.separated_by.to_owned(),
        }
    };
    json(&catalogue().iter().copied().map(row).collect::<Vec<EffectRow>>())
}

async fn exported(State(server): Shared) -> Answered {
    let bench = Arc::clone(&server.bench);
    Ok(Html(apart(move || export(&bench)).await?).into_response())
}
