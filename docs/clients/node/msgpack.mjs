// The part of msgpack that the protocol's headers need: what JSON has. (https://msgpack.org)

/** Encodes null, booleans, numbers, BigInts, text, lists and objects. */
export function encode(value) {
  const parts = [];
  write(value, parts);
  return Buffer.concat(parts);
}

function head(parts, size, ...bytes) {
  const buffer = Buffer.alloc(1 + size);
  buffer[0] = bytes[0];
  if (size) buffer.writeUIntBE(bytes[1], 1, size);
  parts.push(buffer);
}

function write(value, parts) {
  if (value === null || value === undefined) return head(parts, 0, 0xc0);
  if (typeof value === "boolean") return head(parts, 0, value ? 0xc3 : 0xc2);
  if (typeof value === "bigint" || typeof value === "number") return writeNumber(value, parts);
  if (typeof value === "string") {
    const text = Buffer.from(value, "utf8"), n = text.length;
    if (n < 32) head(parts, 0, 0xa0 | n);
    else if (n < 256) head(parts, 1, 0xd9, n);
    else head(parts, 2, 0xda, n);
    return parts.push(text);
  }
  if (Array.isArray(value)) {
    if (value.length < 16) head(parts, 0, 0x90 | value.length);
    else head(parts, 2, 0xdc, value.length);
    return value.forEach((item) => write(item, parts));
  }
  const entries = Object.entries(value);
  if (entries.length < 16) head(parts, 0, 0x80 | entries.length);
  else head(parts, 2, 0xde, entries.length);
  for (const [key, item] of entries) {
    write(key, parts);
    write(item, parts);
  }
}

function writeNumber(value, parts) {
  if (typeof value === "number" && !Number.isInteger(value)) {
    const buffer = Buffer.alloc(9);
    buffer[0] = 0xcb;
    buffer.writeDoubleBE(value, 1);
    return parts.push(buffer);
  }
  if (value >= 0 && value < 128) return head(parts, 0, Number(value));
  const buffer = Buffer.alloc(9);
  buffer[0] = value < 0 ? 0xd3 : 0xcf;
  if (value < 0) buffer.writeBigInt64BE(BigInt(value), 1);
  else buffer.writeBigUInt64BE(BigInt(value), 1);
  parts.push(buffer);
}

/** Decodes one value that fills the buffer. Integers beyond 2^53 become BigInt. */
export function decode(buffer) {
  const state = { buffer, at: 0 };
  const value = read(state);
  if (state.at !== buffer.length) throw new Error("bytes follow the value");
  return value;
}

function uint(s, size) {
  const value = size === 8 ? s.buffer.readBigUInt64BE(s.at) : s.buffer.readUIntBE(s.at, size);
  s.at += size;
  return typeof value === "bigint" && value <= Number.MAX_SAFE_INTEGER ? Number(value) : value;
}

function int(s, size) {
  const value = size === 8 ? s.buffer.readBigInt64BE(s.at) : s.buffer.readIntBE(s.at, size);
  s.at += size;
  return typeof value === "bigint" && value >= Number.MIN_SAFE_INTEGER ? Number(value) : value;
}

function text(s, size) {
  s.at += size;
  return s.buffer.toString("utf8", s.at - size, s.at);
}

const list = (s, size) => Array.from({ length: size }, () => read(s));
const map = (s, size) =>
  Object.fromEntries(Array.from({ length: size }, () => [read(s), read(s)]));

function read(s) {
  const type = uint(s, 1);
  if (type < 0x80) return type;
  if (type < 0x90) return map(s, type & 15);
  if (type < 0xa0) return list(s, type & 15);
  if (type < 0xc0) return text(s, type & 31);
  if (type >= 0xe0) return type - 256;
  switch (type) {
    case 0xc0: return null;
    case 0xc2: return false;
    case 0xc3: return true;
    case 0xca: s.at += 4; return s.buffer.readFloatBE(s.at - 4);
    case 0xcb: s.at += 8; return s.buffer.readDoubleBE(s.at - 8);
    case 0xcc: case 0xcd: case 0xce: case 0xcf: return uint(s, 1 << (type - 0xcc));
    case 0xd0: case 0xd1: case 0xd2: case 0xd3: return int(s, 1 << (type - 0xd0));
    case 0xd9: return text(s, uint(s, 1));
    case 0xda: return text(s, uint(s, 2));
    case 0xdb: return text(s, uint(s, 4));
    case 0xdc: return list(s, uint(s, 2));
    case 0xdd: return list(s, uint(s, 4));
    case 0xde: return map(s, uint(s, 2));
    case 0xdf: return map(s, uint(s, 4));
    default: throw new Error(`type 0x${type.toString(16)} is not of this protocol`);
  }
}
