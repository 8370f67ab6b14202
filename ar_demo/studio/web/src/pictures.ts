/** Pictures of frames from the server: decoded, cached up to a number of bytes, the most wanted first. */

import { sentence } from "./api";

const AGAIN_MS = 2000;
const BYTES = 256 * 2 ** 20;

export class Pictures {
  private readonly cache = new Map<number, ImageBitmap>();
  private readonly loading = new Set<number>();
  private readonly failed = new Set<number>();
  private queue: number[] = [];
  private bytes = 0;
  private closed = false;

  /** @param address of a frame's picture. @param loaded called when one came, with an error's text when it did not.
   * @param atOnce how many requests are under way at the same time. */
  constructor(
    private readonly address: (index: number) => string,
    private readonly loaded: (index: number, error: string | null) => void,
    private readonly atOnce = 3,
  ) {}

  get(index: number): ImageBitmap | null {
    const picture = this.cache.get(index);
    if (!picture) return null;
    this.cache.delete(index); // the last used goes last
    this.cache.set(index, picture);
    return picture;
  }

  has = (index: number) => this.cache.has(index) || this.failed.has(index);

  /** Asks for these, in this order; what was asked for before and has not been begun is dropped. */
  want(indices: number[]): void {
    this.queue = indices.filter((i) => !this.has(i) && !this.loading.has(i));
    this.next();
  }

  close(): void {
    this.closed = true;
    this.queue = [];
    for (const picture of this.cache.values()) picture.close();
    this.cache.clear();
  }

  private next(): void {
    while (this.loading.size < this.atOnce && this.queue.length) void this.load(this.queue.shift()!);
  }

  private async load(index: number): Promise<void> {
    this.loading.add(index);
    let error: string | null = null;
    try {
      const response = await fetch(this.address(index));
      if (!response.ok) {
        const content = (await response.json().catch(() => ({}))) as { error?: string };
        throw new Error(sentence(content.error ?? `frame ${index} cannot be shown (status ${response.status})`));
      }
      const picture = await createImageBitmap(await response.blob());
      if (this.closed) return picture.close();
      this.keep(index, picture);
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

  private keep(index: number, picture: ImageBitmap): void {
    this.cache.set(index, picture);
    this.bytes += picture.width * picture.height * 4;
    for (const [oldest, other] of this.cache) {
      if (this.bytes <= BYTES || oldest === index) break;
      this.bytes -= other.width * other.height * 4;
      this.cache.delete(oldest);
      other.close();
    }
  }
}
