//! Places in object storage, by `object_store`.

use std::fs;
use std::future::Future;
use std::io::{Read, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use bytes::Bytes;
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::path::Path as Key;
use object_store::{
    ClientOptions, Error, ObjectStore, ObjectStoreExt, PutMode, PutPayload, RetryConfig, WriteMultipart,
};
use tokio::runtime::Runtime;

use crate::{ObjectError, parts};

/// Requests at a time.
const AT_ONCE: usize = 16;
/// Larger files are sent in parts.
const PART_BYTES: usize = 16 << 20;
/// A server that cannot be reached for longer has failed.
const CONNECT: Duration = Duration::from_secs(5);
/// Time for all attempts of a request.
const PATIENCE: Duration = Duration::from_secs(60);
/// Attempts after the first one.
const RETRIES: usize = 4;

/// A place in object storage: a bucket, or what begins with a prefix in it.
#[derive(Debug, Clone)]
pub struct Place {
    store: Arc<dyn ObjectStore>,
    address: String,
    prefix: String,
}

impl Place {
    /// The place of a path. Nothing is asked yet.
    ///
    /// # Errors
    /// An invalid address, or settings of the environment that cannot be used.
    pub fn open(path: &Path) -> Result<Self, ObjectError> {
        let address = path.to_string_lossy();
        let (bucket, prefix) = parts(&address)?;
        let settings = AmazonS3Builder::from_env();
        let endpoint = settings.get_config_value(&AmazonS3ConfigKey::Endpoint).unwrap_or_default();
        // A server of one's own, by its address; Amazon's is asked with TLS.
        let options = ClientOptions::new()
            .with_connect_timeout(CONNECT)
            .with_allow_http(endpoint.starts_with("http://"));
        let retry = RetryConfig { max_retries: RETRIES, retry_timeout: PATIENCE, ..RetryConfig::default() };
        let store = settings.with_bucket_name(bucket).with_client_options(options).with_retry(retry).build();
        let store = store.map_err(|error| refused("use", &address, &error))?;
        Ok(Self::of(Arc::new(store), bucket, prefix))
    }

    /// A place in a store.
    pub(crate) fn of(store: Arc<dyn ObjectStore>, bucket: &str, prefix: &str) -> Self {
        let address = format!("s3://{bucket}/{prefix}").trim_end_matches('/').to_owned();
        Self { store, address, prefix: prefix.to_owned() }
    }

    /// Its address, without a slash at its end.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }

    /// A place below this one.
    #[must_use]
    pub fn below(&self, name: &str) -> Self {
        Self {
            store: Arc::clone(&self.store),
            address: format!("{}/{name}", self.address),
            prefix: self.named(name),
        }
    }

    fn named(&self, name: &str) -> String {
        [self.prefix.as_str(), name].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("/")
    }

    /// The name as it is: nothing is encoded, so that names of a list are names to ask for.
    fn key(&self, name: &str) -> Result<Key, ObjectError> {
        let whole = self.named(name);
        Key::parse(&whole).map_err(|error| refused("use", &whole, &error.into()))
    }

    fn refused<'a>(&'a self, action: &'static str, name: &'a str) -> impl Fn(Error) -> ObjectError + 'a {
        move |error| refused(action, &format!("{}/{name}", self.address), &error)
    }

    /// The content of an object; `None` where there is none.
    ///
    /// # Errors
    /// The server's.
    pub fn get(&self, name: &str) -> Result<Option<Vec<u8>>, ObjectError> {
        wait(self.got(name))?
    }

    async fn got(&self, name: &str) -> Result<Option<Vec<u8>>, ObjectError> {
        let refused = self.refused("read", name);
        match self.store.get(&self.key(name)?).await {
            Ok(found) => Ok(Some(found.bytes().await.map_err(refused)?.to_vec())),
            Err(Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(refused(error)),
        }
    }

    /// The contents of objects, several at a time, in the order of their names.
    ///
    /// # Errors
    /// The server's.
    pub fn get_all(&self, names: &[String]) -> Result<Vec<Option<Vec<u8>>>, ObjectError> {
        wait(stream::iter(names).map(|name| self.got(name)).buffered(AT_ONCE).try_collect())?
    }

    /// Writes an object, whole or not at all, in place of what was there.
    ///
    /// # Errors
    /// The server's.
    pub fn put(&self, name: &str, content: Vec<u8>) -> Result<(), ObjectError> {
        let sent = wait(self.store.put(&self.key(name)?, PutPayload::from(content)))?;
        sent.map(|_| ()).map_err(self.refused("write", name))
    }

    /// Writes an object unless there is one, of several writers the first; returns whether it was written.
    ///
    /// # Errors
    /// The server's.
    pub fn put_new(&self, name: &str, content: Vec<u8>) -> Result<bool, ObjectError> {
        let payload = PutPayload::from(content);
        match wait(self.store.put_opts(&self.key(name)?, payload, PutMode::Create.into()))? {
            Ok(_) => Ok(true),
            Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) => Ok(false),
            Err(error) => Err(self.refused("write", name)(error)),
        }
    }

    /// Names of all objects here and below, sorted.
    ///
    /// # Errors
    /// The server's.
    pub fn names(&self) -> Result<Vec<String>, ObjectError> {
        let below = self.key("")?;
        let listed = self.store.list(Some(&below)).map_ok(|object| object.location.to_string());
        let listed: Vec<String> = wait(listed.try_collect())?.map_err(self.refused("list", ""))?;
        let start = if self.prefix.is_empty() { String::new() } else { format!("{below}/") };
        let mut names: Vec<String> =
            listed.iter().filter_map(|key| key.strip_prefix(&start)).map(str::to_owned).collect();
        names.sort_unstable();
        Ok(names)
    }

    /// Copies what is here: one object to the file, or everything below into the folder, of this path. Returns the number of
    /// files.
    ///
    /// # Errors
    /// The server's; [`ObjectError::Nothing`]; a file that cannot be written.
    pub fn fetch(&self, path: &Path) -> Result<usize, ObjectError> {
        let names = self.names()?;
        if names.is_empty() {
            return wait(self.copied("", path))?.map(|()| 1);
        }
        let each = names.iter().map(|name| {
            // Names come from a server: none leads out of the folder.
            let file: PathBuf =
                Path::new(name).components().filter(|part| matches!(part, Component::Normal(_))).collect();
            async move { self.copied(name, &path.join(file)).await }
        });
        wait(stream::iter(each).buffer_unordered(AT_ONCE).try_collect::<()>())??;
        Ok(names.len())
    }

    async fn copied(&self, name: &str, file: &Path) -> Result<(), ObjectError> {
        let address = || match name {
            "" => self.address.clone(),
            name => format!("{}/{name}", self.address),
        };
        let mut content = match self.store.get(&self.key(name)?).await {
            Ok(found) => found.into_stream(),
            Err(Error::NotFound { .. }) => return Err(ObjectError::Nothing(address())),
            Err(error) => return Err(refused("read", &address(), &error)),
        };
        if let Some(folder) = file.parent() {
            fs::create_dir_all(folder).map_err(ObjectError::io("create", folder))?;
        }
        let mut written = whorl_files::NewFile::create(file).map_err(ObjectError::io("write", file))?;
        while let Some(bytes) = content.next().await {
            let bytes = bytes.map_err(|error| refused("read", &address(), &error))?;
            written.write_all(&bytes).map_err(ObjectError::io("write", file))?;
        }
        written.finish().map_err(ObjectError::io("write", file))
    }

    /// Copies all files of a folder, and of those in it, here. Returns their number.
    ///
    /// # Errors
    /// The server's; a file that cannot be read.
    pub fn publish(&self, folder: &Path) -> Result<usize, ObjectError> {
        let mut files = Vec::new();
        files_below(folder, String::new(), &mut files)?;
        let count = files.len();
        let each = files.into_iter().map(|(name, file)| async move { self.sent(&name, &file).await });
        wait(stream::iter(each).buffer_unordered(AT_ONCE).try_collect::<()>())??;
        Ok(count)
    }

    async fn sent(&self, name: &str, path: &Path) -> Result<(), ObjectError> {
        let (key, refused) = (self.key(name)?, self.refused("write", name));
        let mut file = fs::File::open(path).map_err(ObjectError::io("read", path))?;
        let mut read = || -> Result<Vec<u8>, ObjectError> {
            let mut part = Vec::new();
            (&mut file)
                .take(PART_BYTES as u64)
                .read_to_end(&mut part)
                .map_err(ObjectError::io("read", path))?;
            Ok(part)
        };
        let first = read()?;
        if first.len() < PART_BYTES {
            return self.store.put(&key, PutPayload::from(first)).await.map(|_| ()).map_err(refused);
        }
        // It appears when all parts have been sent.
        let upload = self.store.put_multipart(&key).await.map_err(&refused)?;
        let mut writer = WriteMultipart::new_with_chunk_size(upload, PART_BYTES);
        let mut part = first;
        while !part.is_empty() {
            writer.wait_for_capacity(AT_ONCE).await.map_err(&refused)?;
            writer.put(Bytes::from(part));
            part = read()?;
        }
        writer.finish().await.map(|_| ()).map_err(refused)
    }
}

/// Names (with slashes) and paths of all files in and below a folder.
fn files_below(folder: &Path, above: String, files: &mut Vec<(String, PathBuf)>) -> Result<(), ObjectError> {
    for entry in fs::read_dir(folder).map_err(ObjectError::io("read", folder))? {
        let entry = entry.map_err(ObjectError::io("read", folder))?;
        let (path, own) = (entry.path(), entry.file_name());
        let name = format!("{above}{}", own.to_string_lossy());
        if path.is_dir() {
            files_below(&path, format!("{name}/"), files)?;
        } else {
            files.push((name, path));
        }
    }
    Ok(())
}

fn refused(action: &'static str, address: &str, error: &Error) -> ObjectError {
    // The causes say what the outermost sentence only names.
    let mut reasons: Vec<String> = Vec::new();
    let mut cause: Option<&dyn std::error::Error> = Some(error);
    while let Some(error) = cause {
        let said = error.to_string();
        if !reasons.iter().any(|before| before.contains(&said)) {
            reasons.push(said);
        }
        cause = error.source();
    }
    let reason = reasons.join(": ").replace(['\n', '\r'], " ");
    ObjectError::Refused { action, address: address.trim_end_matches('/').to_owned(), reason }
}

/// Waits for an answer; threads may wait at the same time.
fn wait<F: Future>(future: F) -> Result<F::Output, ObjectError> {
    static RUNTIME: OnceLock<Result<Runtime, String>> = OnceLock::new();
    let started = RUNTIME.get_or_init(|| {
        tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(|error| error.to_string())
    });
    match started {
        Ok(runtime) => Ok(runtime.block_on(future)),
        Err(reason) => Err(ObjectError::Refused {
            action: "use",
            address: "object storage".to_owned(),
            reason: reason.clone(),
        }),
    }
}
