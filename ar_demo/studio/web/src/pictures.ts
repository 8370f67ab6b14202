/** Pictures of frames from the server: decoded, cached up to a number of bytes, the most wanted first. */

import { sentence } from "./api";

const AGAIN_MS = 2000;
const BYTES = 256 * 2 ** 20;

/** What is shown until a frame's own picture comes. */
export interface StandIn {
  /** The frame that it is shown for, and the one that it shows. */
  instead: number;
  frame: number;
  picture: ImageBitmap;
}

export class Pictures {
  private readonly cache = new Map<number, ImageBitmap>();
  private readonly loading = new Set<number>();
  private readonly failed = new Set<number>();
  private queue: number[] = [];
  private wanted: number[] = [];
  private bytes = 0;
  private stand: StandIn | null = null;
  private readonly shown = new Map<number, number>();
  private closed = false;

  /** @param address of a frame's picture; `near`, where it is given, is a frame that is shown meanwhile (-1 for none): the
   * server answers in a moment, maybe with a nearer one. @param loaded called when one came, with an error's text when
   * it did not. @param atOnce how many requests are under way at the same time. */
  constructor(
    private readonly address: (index: number, near: number) => string,
    private readonly loaded: (index: number, error: string | null) => void,
    private readonly atOnce = 3,
    /** Whether a frame nearby is as good, until `renew`. */
    private readonly rough = false,
  ) {}

  get(index: number): ImageBitmap | null {
    const picture = this.cache.get(index);
    if (!picture) return null;
    this.cache.delete(index); // the last used goes last
    this.cache.set(index, picture);
    return picture;
  }

  /** A picture of a frame nearby, until the one that is wanted is here. */
  near(index: number): StandIn | null {
    return this.stand?.instead === index ? this.stand : null;
  }

  /** The frame that a rough picture shows. */
  actual = (index: number) => this.shown.get(index) ?? index;

  /** Asks again for rough pictures. */
  renew(indices: number[]): void {
    this.queue.push(...indices.filter((i) => !this.queue.includes(i) && !this.loading.has(i)));
    this.next();
  }

  has = (index: number) => this.cache.has(index) || this.failed.has(index);

  /** Asks for these, in this order; what was asked for before and has not been begun is dropped. */
  want(indices: number[]): void {
    this.wanted = indices;
    this.queue = indices.filter((i) => !this.has(i) && !this.loading.has(i));
    this.next();
  }

  close(): void {
    this.closed = true;
    this.queue = [];
    for (const picture of this.cache.values()) picture.close();
    this.cache.clear();
    this.stand?.picture.close();
    this.stand = null;
  }

  private next(): void {
    while (this.loading.size < this.atOnce && this.queue.length) void this.load(this.queue.shift()!);
  }

  private async load(index: number): Promise<void> {
    this.loading.add(index);
    let error: string | null = null;
    try {
      let picture = await this.fetch(index);
      while (!picture && this.wanted.includes(index) && !this.closed) picture = await this.fetch(index);
      if (this.closed) return picture?.close();
      if (picture) this.keep(index, picture);
    } catch (problem) {
      error = problem instanceof TypeError ? "The server does not answer." : (problem as Error).message;
      this.failed.add(index);
      setTimeout(() => {
        this.failed.delete(index); // asked for again later, not at once
        if (!this.closed) this.loaded(index, error);
      }, AGAIN_MS);
    }
    this.loading.delete(index);
    if (this.closed) return;
    this.loaded(index, error);
    this.next();
  }

  /** A frame's own picture; null where there is none yet. */
  private async fetch(index: number): Promise<ImageBitmap | null> {
    // Only for the frame that is wanted most something else is shown.
    const response = await fetch(this.address(index, this.wanted[0] === index ? (this.near(index)?.frame ?? -1) : index));
    if (!response.ok) {
      const content = (await response.json().catch(() => ({}))) as { error?: string };
      throw new Error(sentence(content.error ?? `frame ${index} cannot be shown (status ${response.status})`));
    }
    if (response.status === 202) return null;
    const picture = await createImageBitmap(await response.blob());
    const frame = Number(response.headers.get("x-frame") ?? index);
    if (frame === index || this.rough) {
      this.shown.set(index, frame);
      return picture;
    }
    this.stand?.picture.close();
    this.stand = { instead: index, frame, picture };
    if (!this.closed) this.loaded(index, null);
    return null;
  }

  private keep(index: number, picture: ImageBitmap): void {
    const old = this.cache.get(index);
    if (old) {
      this.bytes -= old.width * old.height * 4;
      old.close();
      this.cache.delete(index);
    }
    this.cache.set(index, picture);
    if (this.near(index)) {
      this.stand!.picture.close();
      this.stand = null;
    }
    this.bytes += picture.width * picture.height * 4;
    for (const [oldest, other] of this.cache) {
      if (this.bytes <= BYTES || oldest === index) break;
      this.bytes -= other.width * other.height * 4;
      this.cache.delete(oldest);
      other.close();
    }
  }
}
