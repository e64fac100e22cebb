// Foxglove's own client (@foxglove/ws-protocol) and decoders list what `whorl live --foxglove` serves, subscribe to
// everything of one kind, and decode it; and checks that the layout shows
// topics and fields that there are. usage: node client.mjs ws://ADDRESS:PORT/foxglove LAYOUT.json PLATFORM...
// Prints what was seen as JSON; fails when something is missing or does not decode.

import protocol from "@foxglove/ws-protocol";
import rosmsg from "@foxglove/rosmsg";
import serialization from "@foxglove/rosmsg2-serialization";
import WebSocket from "ws";
import { readFileSync } from "node:fs";

const { FoxgloveClient } = protocol;
const [url, layoutFile, ...platforms] = process.argv.slice(2);
// What the panels of the layout show: /topic.field...
const layout = JSON.parse(readFileSync(layoutFile, "utf8"));
const shown = Object.values(layout.configById).flatMap((panel) => [...(panel.paths ?? []).map((path) => path.value), panel.topicPath, panel.topicToRender].filter(Boolean));
const wanted = new Set(["/formation/state", ...platforms.flatMap((name) => [`/${name}/attitude/estimate`, `/${name}/imu/data_raw`])]);
const seen = { channels: [], messages: {} };
const readers = new Map();
const fail = (why) => { console.error(`error: ${why}`); process.exit(1); };

const socket = new WebSocket(url, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]);
const client = new FoxgloveClient({ ws: socket });
client.on("error", (error) => fail(error.message ?? error));
client.on("advertise", (channels) => {
  for (const channel of channels) {
    seen.channels.push(`${channel.topic} ${channel.schemaName}`);
    // Every definition is understood, whether or not anything is published.
    const definitions = rosmsg.parse(channel.schema, { ros2: true });
    if (channel.encoding !== "cdr" || channel.schemaEncoding !== "ros2msg") fail(`${channel.topic}: ${channel.encoding}, ${channel.schemaEncoding}`);
    if (wanted.has(channel.topic)) readers.set(client.subscribe(channel.id), { topic: channel.topic, reader: new serialization.MessageReader(definitions) });
  }
  for (const path of shown) {
    const [, topic, field] = path.match(/^([^.]+)(?:\.([a-z_]+))?/);
    const channel = channels.find((c) => c.topic === topic) ?? fail(`the layout shows ${topic}, which there is not`);
    const fields = rosmsg.parse(channel.schema, { ros2: true })[0].definitions.map((d) => d.name);
    if (field && !fields.includes(field)) fail(`the layout shows ${path}; ${topic} has ${fields.join(", ")}`);
  }
  if (readers.size !== wanted.size) fail(`advertised: ${seen.channels.join(", ")}`);
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic, reader } = readers.get(subscriptionId);
  const message = reader.readMessage(data);
  const late_s = Math.abs(Date.now() / 1e3 - Number(timestamp) / 1e9);
  if (late_s > 5) fail(`${topic}: received ${late_s} s from now`);
  if (topic.endsWith("/attitude/estimate")) {
    const q = message.q_world_body;
    if (Math.abs(Math.hypot(q.w, q.x, q.y, q.z) - 1) > 1e-9) fail(`${topic}: no unit quaternion: ${JSON.stringify(q)}`);
  }
  if (topic === "/formation/state" && message.platforms.join(" ") !== platforms.join(" ")) fail(`${topic}: ${message.platforms}`);
  seen.messages[topic] = (seen.messages[topic] ?? 0) + 1;
  if ([...wanted].every((name) => seen.messages[name] >= 10)) {
    for (const id of readers.keys()) client.unsubscribe(id);
    console.log(JSON.stringify(seen));
    client.close();
    process.exit(0);
  }
});
setTimeout(() => fail(`not all within 30 s: ${JSON.stringify(seen.messages)}`), 30_000);
