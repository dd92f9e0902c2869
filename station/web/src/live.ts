// Live updates: server-sent events, which are opened again after a break, with what was missed read from the history.
//
// In: the station's events `position`, `event`, `changed`, `missed`. Out: calls of the listener, in this order after a
// break: `fill(since)` with the time of the last position that was received, then the updates as they come.

import { isLater, type StationEvent, type TagPosition } from './model.js';

/// What of EventSource is used, so that tests can have their own.
export interface Source {
  onopen: ((event: Event) => unknown) | null;
  onerror: ((event: Event) => unknown) | null;
  addEventListener(type: string, listener: (message: { data: string }) => void): void;
  close(): void;
}

export type Connection = 'connecting' | 'live' | 'reconnecting';

export interface Listener {
  position(position: TagPosition): void;
  event(event: StationEvent): void;
  /// Tags, nodes or zones are to be read again.
  changed(): void;
  /// Reads what came after `since` (null: nothing was received yet) from the history.
  fill(since: string | null): Promise<void>;
  connection(state: Connection): void;
}

export interface Timers {
  set(run: () => void, ms: number): unknown;
  clear(handle: unknown): void;
  now(): number;
}

export const FIRST_WAIT_MS = 500;
/// A station that is back is found within five seconds, the filling of the gap included.
export const LONGEST_WAIT_MS = 2500;

const browserTimers: Timers = {
  set: (run, ms) => setTimeout(run, ms),
  clear: (handle) => clearTimeout(handle as number),
  now: () => performance.now(),
};

export class Live {
  private source: Source | null = null;
  private timer: unknown = null;
  private wait = FIRST_WAIT_MS;
  private since: string | null = null;
  private lastMessage = 0;
  /// The connection whose gap is being filled. An answer may never come when that connection is lost.
  private filling: Source | null = null;
  private fillAgain = false;
  private stopped = false;

  constructor(
    private readonly open: () => Source,
    private readonly listener: Listener,
    private readonly timers: Timers = browserTimers,
  ) {}

  start(): void {
    this.listener.connection('connecting');
    this.connect();
  }

  stop(): void {
    this.stopped = true;
    this.timers.clear(this.timer);
    this.source?.close();
    this.source = null;
  }

  /// Opens the connection again when nothing was received for `ms`: a phone that slept does not notice that its
  /// connection is dead.
  refresh(ms: number): void {
    if (this.stopped || this.timers.now() - this.lastMessage < ms) return;
    this.lost(0);
  }

  private connect(): void {
    if (this.stopped) return;
    const source = this.open();
    this.source = source;
    const on = <T>(type: string, take: (data: T) => void) =>
      source.addEventListener(type, (message) => {
        if (this.source !== source) return;
        this.lastMessage = this.timers.now();
        const data = parse<T>(message.data);
        if (data !== undefined) take(data);
      });
    source.onopen = () => {
      if (this.source !== source) return;
      this.lastMessage = this.timers.now();
      this.wait = FIRST_WAIT_MS;
      this.listener.connection('live');
      void this.fill();
    };
    source.onerror = () => {
      if (this.source === source) this.lost(this.wait);
    };
    on<TagPosition>('position', (position) => {
      // While a gap is filled, `since` stays: if the filling fails, it begins there again.
      if (this.filling === null && (this.since === null || isLater(position.t, this.since))) this.since = position.t;
      this.listener.position(position);
    });
    on<StationEvent>('event', (event) => this.listener.event(event));
    source.addEventListener('changed', () => {
      if (this.source === source) this.listener.changed();
    });
    source.addEventListener('missed', () => {
      if (this.source === source) void this.fill();
    });
  }

  private lost(wait: number): void {
    this.source?.close();
    this.source = null;
    this.listener.connection('reconnecting');
    this.timers.clear(this.timer);
    this.timer = this.timers.set(() => this.connect(), wait);
    this.wait = Math.min(this.wait * 2, LONGEST_WAIT_MS);
  }

  private async fill(): Promise<void> {
    const source = this.source;
    if (this.filling === source) {
      this.fillAgain = true;
      return;
    }
    this.filling = source;
    let isFilled = true;
    try {
      do {
        this.fillAgain = false;
        await this.listener.fill(this.since);
      } while (this.fillAgain && this.filling === source);
    } catch {
      isFilled = false;
    }
    // A later connection fills the gap.
    if (this.filling !== source) return;
    this.filling = null;
    // The history cannot be read: the gap stays open, and the next connection begins at the same time again.
    if (!isFilled && this.source === source) this.lost(this.wait);
  }
}

function parse<T>(text: string): T | undefined {
  try {
    return JSON.parse(text) as T;
  } catch {
    return undefined;
  }
}
