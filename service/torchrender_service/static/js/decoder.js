// The decode worker as a promise.

export class Decoder {
  constructor() {
    this.worker = new Worker(new URL("./decode-worker.js", import.meta.url), { type: "module" });
    this.waiting = new Map();
    this.serial = 0;
    this.worker.onmessage = ({ data: { serial, image, error } }) => {
      const { resolve, reject } = this.waiting.get(serial);
      this.waiting.delete(serial);
      if (error) reject(new Error(error));
      else resolve(image);
    };
    this.worker.onerror = (event) => {
      for (const { reject } of this.waiting.values()) reject(new Error(event.message || "the decoder stopped"));
      this.waiting.clear();
    };
  }

  /** Decode one KEYFRAME message (its ArrayBuffer is taken); images come in the order of the calls. */
  decode(buffer, maxPixels) {
    const serial = ++this.serial;
    return new Promise((resolve, reject) => {
      this.waiting.set(serial, { resolve, reject });
      this.worker.postMessage({ serial, buffer, maxPixels }, [buffer]);
    });
  }
}
