// node-mavlink (TypeScript, its own MAVLink) as the receiver: decodes a file of raw bytes, prints JSON lines.
// node node_receiver.mjs FILE [KEY, 64 hexadecimal digits]
import { createReadStream } from 'node:fs'
import { createRequire } from 'node:module'

const require = createRequire(process.env.NODE_PEERS + '/')
const { MavLinkPacketSplitter, MavLinkPacketParser } = require('node-mavlink')
const { minimal, common } = require('mavlink-mappings')
const registry = { ...minimal.REGISTRY, ...common.REGISTRY }
const key = process.argv[3] ? Buffer.from(process.argv[3], 'hex') : null

const plain = (_, value) => typeof value === 'bigint' ? Number(value) : Number.isNaN(value) ? 'NaN' : value
const reader = createReadStream(process.argv[2])
  .pipe(new MavLinkPacketSplitter({}, { verbose: false }))
  .pipe(new MavLinkPacketParser())
reader.on('data', (packet) => {
  const kind = registry[packet.header.msgid]
  const signed = packet.signature ? (key ? packet.signature.matches(key) : true) : null
  const data = kind ? packet.protocol.data(packet.payload, kind) : null
  console.log(JSON.stringify({
    msgid: packet.header.msgid, name: kind ? kind.MSG_NAME : '', seq: packet.header.seq,
    source: [packet.header.sysid, packet.header.compid], magic: packet.header.magic, signed, fields: data
  }, plain))
})
