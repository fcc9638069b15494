/** Acts that are signed: the server asks for the password again, and the page asks the person. */

import { create } from "zustand";

interface Signing {
  /** Answers whoever waits for the password; null: nobody does. */
  answer: ((isSigned: boolean) => void) | null;
  end: (isSigned: boolean) => void;
}

export const useSigning = create<Signing>((set, get) => ({
  answer: null,
  end: (isSigned) => {
    get().answer?.(isSigned);
    set({ answer: null });
  },
}));

/** Ask for the password; true once the server has taken it, false when the person gives up. */
export function askPassword(): Promise<boolean> {
  return new Promise((resolve) => {
    const before = useSigning.getState().answer;
    useSigning.setState({
      answer: (isSigned) => {
        before?.(isSigned);
        resolve(isSigned);
      },
    });
  });
}
