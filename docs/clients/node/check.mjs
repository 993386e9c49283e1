// Checks this client: `node check.mjs golden FILE` against recorded frames,
// `node check.mjs live HOST PORT ID SEED STEPS` prints a trajectory as one JSON line a step.

import assert from "node:assert/strict";
import fs from "node:fs";
import { decode, encode } from "./msgpack.mjs";
import { Client, unpack } from "./rodgym.mjs";

const bytes = (frames) => frames.map((hex) => Buffer.from(hex, "hex"));

// Numbers beyond 2^53 are BigInt here and doubles in JSON.
const plain = (value) => JSON.parse(JSON.stringify(value, (_, v) =>
  typeof v === "bigint" ? Number(v) : v));

function golden(file) {
  let count = 0;
  for (const line of fs.readFileSync(file, "utf8").trim().split("\n")) {
    const { about, request, reply, asks, answers } = JSON.parse(line);
    for (const [hex, told] of [[request, asks], [reply, answers]]) {
      const frames = bytes(hex);
      if (frames[0].length === 0) frames.shift();
      const { header, arrays } = unpack(frames);
      assert.deepEqual(plain(header), told.header, about);
      assert.deepEqual(plain(decode(encode(header))), told.header, `${about}: encoded again`);
      const numbers = Object.fromEntries(
        Object.entries(arrays).map(([name, a]) => [name, plain(Array.from(a))]));
      assert.deepEqual(numbers, told.arrays, about);
    }
    count += 1;
  }
  console.log(`${count} exchanges understood`);
}

async function live(host, port, id, seed, steps) {
  const client = new Client(host, Number(port), { timeout: 30000, attempt: 1000 });
  const env = await client.make(id, { num_envs: 2, max_episode_steps: 5 });
  const show = ({ obs, reward, flags }) => console.log(JSON.stringify({
    obs: Buffer.from(obs.buffer).toString("hex"),
    reward: reward ? Array.from(reward) : null,
    flags: Array.from(flags),
  }));
  show(await env.reset(Number(seed)));
  for (let i = 0; i < Number(steps); i++) show(await env.step([Math.sin(i), Math.cos(i)]));
  const saved = await env.getState();
  const first = await env.step([1, -1]);
  await env.setState(saved);
  const again = await env.step([1, -1]);
  assert.deepEqual(Array.from(again.obs), Array.from(first.obs), "a snapshot brings the state back");
  await assert.rejects(env.step([NaN, 0]), { code: "env" });
  await env.close();
  await assert.rejects(env.step([0, 0]), { code: "no_session" });
  client.close();
}

const [command, ...rest] = process.argv.slice(2);
await { golden, live }[command](...rest);
