-- A Wireshark dissector for the UWB frames of docs/reference/wire-format.md: native mode and DecaRanging. Blinks of
-- DecaRanging have no payload: Wireshark itself shows all of them.
--
-- Wireshark: copy this file into the folder of personal Lua plugins (Help, About, Folders). tshark:
--   tshark -X lua_script:tools/wireshark/baliza.lua -r air.pcap -Y baliza

-- Ticks of the DW1000's clock are 1 / 63.8976 GHz.
local TICK_NS = 1 / 63.8976
local METRES_PER_TICK = 299702547 / 63.8976e9 -- in air
local DECARANGING_PAN = 0xDECA
local MAX_ROUND = 8
local MAX_DATA = 24
local MAX_MEMBERS = 16
local MAX_LEASES = 10
local MAX_POLLS = 6
local MAX_RELAYED = 2
local MAX_IN_RELAY_FRAME = 4
local MAX_PERIOD = 5000 -- superframes
local MAX_BLINKS = 7
local WITH_CODE = 8 -- in a native message's code
local CODE_BYTES = 8
local UNKNOWN_MM = -8388608

local proto = Proto("baliza", "Baliza UWB ranging")
local f = {}
local function field(constructor, name, title, ...)
    local key = name:gsub("%.", "_")
    f[key] = constructor("baliza." .. name, title, ...)
end

field(ProtoField.uint8, "code", "Message", base.HEX)
field(ProtoField.uint16, "round", "Round")
field(ProtoField.uint8, "round.low", "Round, low byte")
local CONFIRMATIONS = { [0] = "none", [1] = "renewed", [2] = "ended" }
field(ProtoField.uint8, "confirmation", "Lease", base.DEC, CONFIRMATIONS)
field(ProtoField.uint8, "count", "Anchors", base.DEC, nil, 0xF0)
field(ProtoField.bool, "with_distances", "With distances", 8, nil, 0x01)
field(ProtoField.bool, "blink", "Blink", 8, nil, 0x08)
field(ProtoField.uint8, "blink.part", "Blink of its slot")
field(ProtoField.uint16, "anchor", "Anchor", base.HEX)
field(ProtoField.double, "distance", "Distance (m)")
field(ProtoField.string, "distance.unknown", "Distance")
field(ProtoField.uint64, "poll_rx", "Poll RX (ticks)")
field(ProtoField.double, "reply", "Response TX − poll RX (µs)")
field(ProtoField.uint8, "final.round", "Final of round, low byte")
field(ProtoField.double, "after_response", "Final RX − response TX (µs)")
field(ProtoField.uint16, "superframe", "Superframe")
field(ProtoField.uint8, "term", "Term")
field(ProtoField.uint8, "age", "Age (superframes)")
field(ProtoField.uint8, "hops", "Hops to the coordinator")
field(ProtoField.uint16, "coordinator", "Coordinator", base.HEX)
field(ProtoField.uint8, "slot", "Sync slot", base.DEC, nil, 0x1F)
field(ProtoField.uint8, "countdown", "List in force in (superframes)", base.DEC, nil, 0xE0)
field(ProtoField.bytes, "slot_owners", "Slot owners (hash of the address, 00: none)", base.SPACE)
field(ProtoField.uint16, "heard", "Members heard", base.HEX)
field(ProtoField.uint8, "version", "List version")
field(ProtoField.uint32, "layout.answer", "Answer (µs)")
field(ProtoField.uint32, "layout.listen_again", "Listen again (µs)")
field(ProtoField.bool, "layout.final", "With a final", 8, nil, 0x80)
field(ProtoField.bool, "layout.new", "In force with the list only", 8, nil, 0x80)
field(ProtoField.uint32, "wish.answer", "Requested answer (µs)")
field(ProtoField.uint32, "wish.listen_again", "Requested listen again (µs)")
field(ProtoField.bool, "wish.final", "Requests a final", 8, nil, 0x80)
field(ProtoField.double, "x", "x (m)")
field(ProtoField.double, "y", "y (m)")
field(ProtoField.double, "z", "z (m)")
field(ProtoField.string, "position.unknown", "Position")
field(ProtoField.double, "sigma_x", "Standard deviation of x (m)")
field(ProtoField.double, "sigma_y", "Standard deviation of y (m)")
field(ProtoField.double, "sigma_z", "Standard deviation of z (m)")
field(ProtoField.double, "rho_xy", "Correlation of x and y")
field(ProtoField.double, "rho_xz", "Correlation of x and z")
field(ProtoField.double, "rho_yz", "Correlation of y and z")
field(ProtoField.bool, "suspect", "Suspect", 8, nil, 0x80)
field(ProtoField.uint8, "data_number", "Number of the user's data")
field(ProtoField.bytes, "data", "Data of the tag's user", base.SPACE)
field(ProtoField.bool, "answer", "Answers a message", 8, nil, 0x80)
field(ProtoField.uint8, "rounds_ago", "Measured this many rounds ago", base.DEC, nil, 0x7F)
field(ProtoField.bool, "passes_request_on", "Passes a request on", 8, nil, 0x80)
field(ProtoField.uint8, "members", "Members", base.DEC, nil, 0x1F)
field(ProtoField.uint8, "leased", "Leased round slots", base.DEC, nil, 0x3F)
field(ProtoField.bool, "has_relay_slots", "Has relay slots", 8, nil, 0x40)
field(ProtoField.bool, "wish.relay_slots", "Requests relay slots")
field(ProtoField.bool, "has_neighbour", "Says where another anchor is", 8, nil, 0x80)
field(ProtoField.uint16, "neighbour", "Another anchor", base.HEX)
field(ProtoField.uint8, "leases", "Leases", base.DEC, nil, 0xF0)
field(ProtoField.uint8, "polls", "Polls passed on", base.DEC, nil, 0x0F)
field(ProtoField.uint16, "member", "Tag", base.HEX)
field(ProtoField.string, "share", "Share")
field(ProtoField.uint16, "requested_by", "Request of tag", base.HEX)
local GRANTS = { [0] = "new", [1] = "kept", [2] = "refused", [3] = "ended" }
field(ProtoField.uint16, "lease", "Lease of tag", base.HEX)
field(ProtoField.uint8, "lease.grant", "Grant", base.DEC, GRANTS, 0xC0)
field(ProtoField.uint8, "lease.slot", "Round slot", base.DEC, nil, 0x3F)
field(ProtoField.uint16, "lease.period", "Period (superframes)")
field(ProtoField.uint16, "lease.phase", "Phase (superframes)")
field(ProtoField.uint8, "lease.part", "Blink of the slot (0: the whole slot)")
field(ProtoField.uint16, "polled_by", "Poll of tag", base.HEX)
field(ProtoField.uint8, "gateway.cost", "Cost of the way to a gateway")
field(ProtoField.uint8, "gateway.next", "Sync slot of the next anchor")
field(ProtoField.uint16, "gateway.taken", "Slots whose entries were taken", base.HEX)
field(ProtoField.uint16, "gateway.taken_frames", "Slots whose relay frames were taken", base.HEX)
field(ProtoField.uint64, "gateway.heard", "Round slots with a poll that it received", base.HEX)
field(ProtoField.uint16, "relayed", "Relayed from tag", base.HEX)
field(ProtoField.double, "relayed.at", "Received in superframe, modulo 256")
field(ProtoField.uint8, "relayed.asked", "Anchors asked", base.DEC, nil, 0x0F)
field(ProtoField.bool, "relayed.data", "Data of the tag's user", 8, nil, 0x80)
field(ProtoField.uint16, "message", "Message to tag", base.HEX)
field(ProtoField.uint16, "message.gateway", "Gateway", base.HEX)
field(ProtoField.uint16, "message.left", "Kept for superframes")
field(ProtoField.uint8, "message.kind", "Kind", base.DEC, { [0] = "data", [1] = "identify", [2] = "rate" }, 0x0F)
field(ProtoField.bool, "has_message", "A message to the tag waits", 8, nil, 0x80)
field(ProtoField.bool, "passes_nothing_on", "Passes nothing on", 8, nil, 0x40)
field(ProtoField.uint32, "session", "Session", base.HEX)
field(ProtoField.uint16, "epoch", "Superframe, high half")
field(ProtoField.bool, "answers", "Answers a challenge", 8, nil, 0x08)
field(ProtoField.uint32, "challenge", "Number of the challenge", base.HEX)
field(ProtoField.bytes, "integrity", "Integrity code", base.SPACE)
-- DecaRanging.
field(ProtoField.uint16, "tag", "Tag's short address", base.HEX)
field(ProtoField.string, "delay.anchor", "Anchor's delay")
field(ProtoField.string, "delay.tag", "Tag's delay")
field(ProtoField.uint8, "temperature", "Temperature (raw)")
field(ProtoField.uint8, "voltage", "Voltage (raw)")
field(ProtoField.bool, "report_follows", "A report follows")
field(ProtoField.int64, "tof", "Time of flight (ticks)")
field(ProtoField.double, "tof.distance", "Time of flight as a distance (m)")
field(ProtoField.uint64, "poll_tx", "Poll TX (ticks)")
field(ProtoField.uint64, "resp_rx", "Response RX (ticks)")
field(ProtoField.uint64, "final_tx", "Final TX (ticks)")
field(ProtoField.double, "reply2", "Final TX − response RX (µs)")
field(ProtoField.double, "round1", "Response RX − poll TX (µs)")

proto.fields = {}
for _, each in pairs(f) do
    table.insert(proto.fields, each)
end

local wrong =
    ProtoExpert.new("baliza.wrong", "Not a frame of this format", expert.group.MALFORMED, expert.severity.ERROR)
proto.experts = { wrong }

local pan_of = Field.new("wpan.dst_pan")

-- A reader of a payload: each call takes the next bytes.
local Reader = {}
Reader.__index = Reader

function Reader.new(tvb, at, stop)
    return setmetatable({ tvb = tvb, at = at, stop = stop }, Reader)
end

function Reader:left()
    return self.stop - self.at
end

function Reader:take(bytes)
    if bytes > self:left() then
        error("too short", 0)
    end
    local range = self.tvb(self.at, bytes)
    self.at = self.at + bytes
    return range
end

function Reader:finish()
    if self:left() > 0 then
        error(self:left() .. " bytes too many", 0)
    end
end

-- A span's code of 7 bits, in microseconds.
local function span_us(code)
    return (16 + code % 16) * 2 ^ math.floor(code / 16)
end

local function ticks_us(ticks)
    return ticks * TICK_NS / 1000
end

local function add_us(tree, which, range)
    tree:add(which, range, ticks_us(range:le_uint()))
end

local function signed(value, bits)
    return value >= 2 ^ (bits - 1) and value - 2 ^ bits or value
end

-- A period's code, in superframes.
local function period_of(code)
    local twos, fives = code % 8, math.floor(code / 8)
    local period = math.floor(2 ^ twos * 5 ^ fives)
    if fives > 5 or period > MAX_PERIOD then
        error(string.format("a period of code 0x%02X", code), 0)
    end
    return period
end

local function period_text(period)
    return "one in " .. period .. (period == 1 and " superframe" or " superframes")
end

local function share_text(byte)
    if byte == 0 then
        return "release"
    elseif byte == 127 then
        return "greedy"
    elseif byte < 127 then
        return byte .. " a superframe"
    end
    return (byte >= 192 and "a blink " or "") .. period_text(period_of(byte % 64))
end

local function add_share(tree, range)
    tree:add(f.share, range, share_text(range:uint()))
end

-- The byte with the span until a tag listens again, and whether rounds have a final.
local function add_tag_byte(tree, range, what)
    tree:add(f[what .. "_listen_again"], range, span_us(range:uint() % 128))
    tree:add(f[what .. "_final"], range)
end

-- Nodes do not read a position that a tag tells: nonsense in it makes no wrong frame.
local function add_position(tree, range, is_told)
    local mm = {}
    for axis = 0, 2 do
        mm[axis] = signed(range(3 * axis, 3):le_uint(), 24)
    end
    local is_wrong = mm[0] == UNKNOWN_MM or mm[1] == UNKNOWN_MM or mm[2] == UNKNOWN_MM
    if is_wrong and (is_told or mm[1] == 0 and mm[2] == 0) then
        tree:add(f.position_unknown, range, "unknown")
        return
    elseif is_wrong then
        error("a coordinate of −8388.608 m", 0)
    end
    for axis, which in ipairs({ f.x, f.y, f.z }) do
        tree:add(which, range(3 * axis - 3, 3), mm[axis - 1] / 1000)
    end
end

-- A deviation's code, in metres.
local function deviation_m(code)
    return code == 0 and 0 or (16 + code % 16) * 2 ^ math.floor(code / 16) / 16000
end

-- A position that a tag tells, with its covariance, whose correlations are in 1/127.
local function add_tag_position(tree, reader)
    add_position(tree, reader:take(9), true)
    for _, which in ipairs({ f.sigma_x, f.sigma_y, f.sigma_z }) do
        local range = reader:take(1)
        tree:add(which, range, deviation_m(range:uint()))
    end
    for _, which in ipairs({ f.rho_xy, f.rho_xz, f.rho_yz }) do
        local range = reader:take(1)
        tree:add(which, range, range:int() / 127)
    end
    local last = reader:take(1)
    tree:add(f.suspect, last)
    tree:add(f.rounds_ago, last)
end

-- Data of a tag's user, a tag's answer to a message, or a message's bytes.
local function add_data(tree, reader)
    tree:add(f.data_number, reader:take(1))
    local range = reader:take(1)
    local length = range:uint() % 128
    tree:add(f.answer, range)
    if length == 0 or length > MAX_DATA then
        error(length .. " bytes of data", 0)
    end
    tree:add(f.data, reader:take(length))
end

local function poll(tree, reader)
    tree:add_le(f.round, reader:take(2))
    local head = reader:take(1)
    local count, options = math.floor(head:uint() / 16), head:uint() % 16
    local is_blink, data, content = options >= 8, options % 8 >= 4, options % 4
    local most = is_blink and 1 or data and MAX_ROUND - 1 or MAX_ROUND
    if content > (is_blink and 0 or 2) or count == 0 and not is_blink or count > most then
        error("options " .. options .. ", " .. count .. " anchors", 0)
    end
    tree:add(f.count, head)
    tree:add(f.with_distances, head)
    tree:add(f.blink, head)
    add_tag_byte(tree, reader:take(1), "wish")
    if is_blink then
        local part = reader:take(1)
        if part:uint() == 0 or part:uint() > MAX_BLINKS then
            error("blink " .. part:uint() .. " of its slot", 0)
        end
        tree:add(f.blink_part, part)
    end
    for _ = 1, count do
        tree:add_le(f.anchor, reader:take(2))
    end
    for _ = 1, content == 1 and count or 0 do
        local range = reader:take(2)
        local units = range:le_int()
        if units == -32768 then
            tree:add(f.distance_unknown, range, "unknown")
        else
            tree:add(f.distance, range, units / 250)
        end
    end
    if content == 2 then
        add_tag_position(tree, reader)
    end
    if data then
        add_data(tree, reader)
    end
    return is_blink and " (blink)" or " of " .. count
end

local function response(tree, reader)
    tree:add(f.round_low, reader:take(1))
    local options = reader:take(1)
    if CONFIRMATIONS[options:uint() % 64] == nil then
        error("options " .. options:uint(), 0)
    end
    tree:add(f.confirmation, options)
    tree:add(f.has_message, options)
    tree:add(f.passes_nothing_on, options)
    tree:add_le(f.poll_rx, reader:take(5))
    add_us(tree, f.reply, reader:take(4))
    if reader:left() > 0 then
        tree:add(f.final_round, reader:take(1))
        add_us(tree, f.after_response, reader:take(4))
        return ", final received"
    end
end

local function add_member(tree, which, range)
    local branch = tree:add_le(which, range(0, 2))
    branch:append_text(", " .. share_text(range(2, 1):uint()))
    add_share(branch, range(2, 1))
    return range(0, 2):le_uint()
end

-- What a sync frame passes on towards the coordinator: a request for slots or one for the layout.
local function add_passed_on(tree, range, is_for_slots)
    if is_for_slots then
        add_member(tree, f.requested_by, range)
        return
    elseif range(2, 1):uint() > 1 then
        error("a request's third byte is not 0 or 1", 0)
    end
    tree:add(f.wish_relay_slots, range(2, 1))
    tree:add(f.wish_answer, range(0, 1), span_us(range(0, 1):uint() % 128))
    add_tag_byte(tree, range(1, 1), "wish")
end

local function add_lease(tree, reader)
    local branch = tree:add_le(f.lease, reader:take(2))
    local slot, code = reader:take(1), reader:take(1)
    local period = period_of(code:uint())
    local range = reader:take(2)
    local phase, part = range:le_uint() % 8192, math.floor(range:le_uint() / 8192)
    local grant = GRANTS[math.floor(slot:uint() / 64)]
    if phase >= period then
        error("phase " .. phase .. " of a period of " .. period, 0)
    end
    -- The slot and the phase of a refused lease say nothing.
    local place = grant ~= "refused" and " from " .. phase .. ", slot " .. slot:uint() % 64 or ""
    place = place .. (part > 0 and ", blink " .. part or "")
    branch:append_text(", " .. grant .. ": " .. period_text(period) .. place)
    branch:add(f.lease_grant, slot)
    branch:add(f.lease_slot, slot)
    branch:add(f.lease_period, code, period)
    branch:add(f.lease_phase, range, phase)
    branch:add(f.lease_part, range, part)
end

-- A message of a host, on its way to a tag.
local function add_message(tree, reader)
    local branch = tree:add_le(f.message, reader:take(2))
    branch:add_le(f.message_gateway, reader:take(2))
    branch:add_le(f.message_left, reader:take(2))
    branch:add(f.message_kind, reader:take(1))
    add_data(branch, reader)
end

-- What an anchor passes on: to a gateway what a tag told in a poll, or a message to a tag.
local function add_relayed(tree, reader)
    if reader:left() > 6 and math.floor(reader.tvb(reader.at + 6, 1):uint() / 16) == 4 then
        return add_message(tree, reader)
    end
    local branch = tree:add_le(f.relayed, reader:take(2))
    branch:add_le(f.round, reader:take(2))
    local at, what = reader:take(2), reader:take(1)
    branch:add(f.relayed_at, at, at:le_uint() / 256)
    branch:add(f.relayed_asked, what)
    branch:add(f.relayed_data, what)
    local kind = math.floor(what:uint() / 16)
    if kind == 0 then
        add_tag_position(branch, reader)
    elseif kind == 8 then
        add_data(branch, reader)
    else
        error("a relayed entry of kind " .. kind, 0)
    end
end

-- The way to a gateway, and how many entries there are.
local function add_relay(tree, reader, entries, has_relay_slots)
    local cost = reader:take(1)
    tree:add(f.gateway_cost, cost)
    local next = reader:take(1)
    tree:add(f.gateway_next, next)
    if next:uint() >= 16 then
        error("a next anchor in slot " .. next:uint(), 0)
    end
    tree:add_le(f.gateway_taken, reader:take(2))
    if has_relay_slots then
        tree:add_le(f.gateway_taken_frames, reader:take(2))
    end
    if cost:uint() == 0 then
        tree:add_le(f.gateway_heard, reader:take(8))
    end
    if entries > MAX_RELAYED then
        error("more than " .. MAX_RELAYED .. " relayed entries", 0)
    end
    for _ = 1, entries do
        add_relayed(tree, reader)
    end
end

local function sync_frame(tree, reader, has_code)
    local superframe = reader:take(2)
    tree:add_le(f.superframe, superframe)
    for _, which in ipairs({ f.term, f.age, f.hops }) do
        tree:add(which, reader:take(1))
    end
    tree:add_le(f.coordinator, reader:take(2))
    local slot = reader:take(1)
    tree:add(f.slot, slot)
    tree:add(f.countdown, slot)
    tree:add(f.slot_owners, reader:take(16))
    -- What these three bytes are is said by the highest bit of the count of members.
    local passed_on = reader:take(3)
    tree:add_le(f.heard, reader:take(2))
    tree:add(f.version, reader:take(1))
    local answer, listen_again = reader:take(1), reader:take(1)
    tree:add(f.layout_answer, answer, span_us(answer:uint() % 128))
    tree:add(f.layout_new, answer)
    add_tag_byte(tree, listen_again, "layout")
    add_position(tree, reader:take(9))
    local count, leased, entries = reader:take(1), reader:take(1), reader:take(1)
    tree:add(f.passes_request_on, count)
    add_passed_on(tree, passed_on, count:uint() >= 128)
    tree:add(f.members, count)
    tree:add(f.leased, leased)
    tree:add(f.has_neighbour, leased)
    tree:add(f.has_relay_slots, leased)
    tree:add(f.leases, entries)
    tree:add(f.polls, entries)
    local polls = entries:uint() % 16
    if has_code then
        tree:add_le(f.session, reader:take(4))
        tree:add_le(f.epoch, reader:take(2))
        tree:add(f.answers, entries)
        if polls >= 8 then
            tree:add_le(f.challenge, reader:take(4))
            polls = polls - 8
        end
    end
    local relays = math.floor(count:uint() / 32) % 4
    if relays > 0 then
        add_relay(tree, reader, relays - 1, leased:uint() % 128 >= 64)
    end
    if leased:uint() >= 128 then
        local branch = tree:add_le(f.neighbour, reader:take(2))
        local place = reader:take(9)
        if signed(place(0, 3):le_uint(), 24) == UNKNOWN_MM then
            error("another anchor without a position", 0)
        end
        add_position(branch, place)
    end
    local last, is_in_order = -1, true
    for i = 1, count:uint() % 32 do
        local range = reader:take(3)
        local tag = add_member(tree, f.member, range)
        if range(2, 1):uint() >= 128 then
            error("a member with a period", 0)
        elseif i > MAX_MEMBERS then
            error("more than " .. MAX_MEMBERS .. " members", 0)
        end
        is_in_order = is_in_order and tag > last
        last = tag
    end
    for i = 1, math.floor(entries:uint() / 16) do
        add_lease(tree, reader)
        if i > MAX_LEASES then
            error("more than " .. MAX_LEASES .. " leases", 0)
        end
    end
    for i = 1, polls do
        local branch = tree:add_le(f.polled_by, reader:take(2))
        add_tag_byte(branch, reader:take(1), "wish")
        if i > MAX_POLLS then
            error("more than " .. MAX_POLLS .. " polls", 0)
        end
    end
    reader:finish()
    if not is_in_order then
        error("members are not in order", 0)
    end
    return " of superframe " .. superframe:le_uint()
end

local function relay_frame(tree, reader)
    for _ = 1, MAX_IN_RELAY_FRAME do
        add_relayed(tree, reader)
        if reader:left() == 0 then
            break
        end
    end
end

local function request(tree, reader)
    local share = reader:take(1)
    add_share(tree, share)
    add_tag_byte(tree, reader:take(1), "wish")
    return ": " .. share_text(share:uint())
end

local function final(tree, reader)
    tree:add_le(f.round, reader:take(2))
end

local function challenge(tree, reader, has_code)
    tree:add_le(f.session, reader:take(4))
    tree:add_le(f.challenge, reader:take(4))
    if not has_code then
        error("a challenge without an integrity code", 0)
    end
end

-- By the code: the message's name, and what reads the bytes after the code.
local NATIVE = {
    [0x30] = { "Poll", poll },
    [0x31] = { "Response", response },
    [0x32] = { "Sync frame", sync_frame },
    [0x33] = { "Request", request },
    [0x34] = { "Final", final },
    [0x35] = { "Challenge", challenge },
    [0x36] = { "Relay frame", relay_frame },
}

local function add_delay(tree, which, range)
    local value = range:le_uint()
    tree:add(which, range, value % 32768 .. (value >= 32768 and " ms" or " µs (older software: ms)"))
end

local function add_flight(tree, range)
    local ticks = range:len() == 4 and range:le_int() or range:le_int64():tonumber()
    tree:add(f.tof, range, Int64(ticks))
    tree:add(f.tof_distance, range, ticks * METRES_PER_TICK)
end

local function nothing() end

local function ranging_init(tree, reader)
    tree:add_le(f.tag, reader:take(2))
    add_delay(tree, f.delay_anchor, reader:take(2))
    if reader:left() > 0 then
        add_delay(tree, f.delay_tag, reader:take(2))
    end
end

local function standard_poll(tree, reader)
    if reader:left() > 0 then
        tree:add(f.temperature, reader:take(1))
        tree:add(f.voltage, reader:take(1))
    end
end

local function standard_response(tree, reader)
    if reader:take(1):uint() ~= 2 then
        error("another option than no action", 0)
    end
    local parameter = reader:take(2)
    tree:add(f.report_follows, parameter(0, 1), parameter(0, 1):uint() == 1)
    if reader:left() > 0 then
        add_flight(tree, reader:take(5))
    end
end

local function standard_final(tree, reader)
    for _, which in ipairs({ f.poll_tx, f.resp_rx, f.final_tx }) do
        tree:add_le(which, reader:take(5))
    end
end

local function standard_report(tree, reader)
    add_flight(tree, reader:take(5))
end

local function fast_final(tree, reader)
    add_us(tree, f.reply2, reader:take(4))
    add_us(tree, f.round1, reader:take(4))
end

local function fast_report(tree, reader)
    add_flight(tree, reader:take(4))
end

local DECARANGING = {
    [0x20] = { "Ranging init", ranging_init },
    [0x21] = { "Poll", standard_poll },
    [0x10] = { "Response", standard_response },
    [0x29] = { "Final", standard_final },
    [0x2A] = { "Report", standard_report },
    [0x61] = { "Fast poll", nothing },
    [0x50] = { "Fast response", nothing },
    [0x69] = { "Fast final", fast_final },
    [0x6A] = { "Fast report", fast_report },
}

local function dissect(tvb, pinfo, root)
    local pan = pan_of()
    if tvb:len() == 0 or pan == nil then
        return false
    end
    local code, messages = tvb(0, 1):uint(), pan.value == DECARANGING_PAN and DECARANGING or NATIVE
    local has_code = messages == NATIVE and math.floor(code / WITH_CODE) % 2 == 1
    local message = messages[has_code and code - WITH_CODE or code]
    if message == nil then
        return false
    end
    local name, rest = message[1], message[2]
    local tree = root:add(proto, tvb())
    tree:add(f.code, tvb(0, 1)):append_text(" (" .. name .. ")")
    local stop = has_code and tvb:len() - CODE_BYTES or tvb:len()
    local reader = Reader.new(tvb, 1, stop)
    -- What follows the name in the list of frames, or what is wrong.
    local is_whole, text = pcall(function()
        local about = rest(tree, reader, has_code)
        reader:finish()
        if has_code then
            tree:add(f.integrity, tvb(stop, CODE_BYTES))
        end
        return about
    end)
    pinfo.cols.protocol = "Baliza"
    pinfo.cols.info = name .. (is_whole and text or "")
    if not is_whole then
        tree:add_proto_expert_info(wrong, "Not a frame of this format: " .. tostring(text))
    end
    return true
end

proto:register_heuristic("wpan", dissect)
