// Listening to the server: goes on by itself when it is away for a while, and says since when nothing has come.

const PATIENCE_MS = 13000; // a sign of life comes every five seconds
const AGAIN_MS = 1500;
const HIDDEN_MS = 60000; // a tab that nobody looks at leaves its connection to others: a browser has six for a server

export class Stream {
  /**
   * @param wanted pairs of kind (run or study) and name
   * @param handlers by the kind of event
   * @param onState called with null when all is well, or with the time since which nothing comes
   */
  constructor(wanted, handlers, onState) {
    this.path = `/api/stream?${wanted.map(([kind, name]) => `${kind}=${encodeURIComponent(name)}`).join("&")}`;
    this.handlers = handlers;
    this.onState = onState;
    this.heard = Date.now();
    this.lostSince = null;
    this.onVisible = () => this.look();
    document.addEventListener("visibilitychange", this.onVisible);
    this.timer = setInterval(() => this.look(), 1000);
    this.open();
  }

  open() {
    this.source?.close();
    this.opened = Date.now();
    const source = new EventSource(this.path);
    this.source = source;
    const hear = (kind, handler) => source.addEventListener(kind, (event) => {
      this.heard = Date.now();
      if (this.lostSince !== null) {
        this.lostSince = null;
        this.onState(null, true);
      }
      handler(JSON.parse(event.data));
    });
    hear("alive", () => {});
    for (const [kind, handler] of Object.entries(this.handlers)) hear(kind, handler);
    source.onerror = () => {
      if (source === this.source) this.lose();
    };
  }

  lose() {
    if (this.lostSince === null) this.lostSince = this.heard;
    this.onState(this.lostSince, false);
  }

  look() {
    if (document.hidden) {
      this.hiddenSince ??= Date.now();
      if (Date.now() - this.hiddenSince > HIDDEN_MS && this.source) {
        this.source.close();
        this.source = null;
      }
      return;
    }
    this.hiddenSince = null;
    const since = Date.now() - Math.max(this.heard, this.opened);
    if (since > PATIENCE_MS) this.lose();
    const closed = this.source === null || this.source.readyState === EventSource.CLOSED;
    if ((closed && Date.now() - this.opened > AGAIN_MS) || since > PATIENCE_MS) this.open();
  }

  close() {
    clearInterval(this.timer);
    document.removeEventListener("visibilitychange", this.onVisible);
    this.source?.close();
    this.source = null;
  }
}
