/** A button that asks for a file, and a place where one may be dropped. */

import { useRef, useState, type ReactNode } from "react";
import { Button } from "./controls";

export function FileButton(props: {
  children: ReactNode;
  accept: string;
  onFile: (file: File) => void;
  label: string;
  why?: string | null;
  look?: "" | "pri";
  large?: boolean;
  testId: string;
}) {
  const input = useRef<HTMLInputElement>(null);
  return (
    <>
      <Button
        {...(props.look === undefined ? {} : { look: props.look })}
        large={props.large ?? false}
        why={props.why}
        onClick={() => input.current?.click()}
        testId={props.testId}
      >
        {props.children}
      </Button>
      <input
        ref={input}
        type="file"
        hidden
        aria-label={props.label}
        accept={props.accept}
        data-testid={`${props.testId}-input`}
        onChange={(event) => {
          const file = event.target.files?.[0];
          event.target.value = "";
          if (file) props.onFile(file);
        }}
      />
    </>
  );
}

/** Where a file may be dropped; `onFile` is null where none may. */
export function DropZone(props: {
  onFile: ((file: File) => void) | null;
  words: string;
  className?: string;
  testId?: string;
  children: ReactNode;
}) {
  const [isOver, setOver] = useState(false);
  const { onFile } = props;
  return (
    <div
      className={`${props.className ?? ""} ${isOver ? "dropping" : ""}`}
      data-testid={props.testId}
      onDragOver={(event) => {
        if (!onFile || !event.dataTransfer.types.includes("Files")) return;
        event.preventDefault();
        setOver(true);
      }}
      onDragLeave={(event) => {
        if (event.currentTarget.contains(event.relatedTarget as Node | null)) return;
        setOver(false);
      }}
      onDrop={(event) => {
        setOver(false);
        const file = event.dataTransfer.files[0];
        if (!onFile || !file) return;
        event.preventDefault();
        onFile(file);
      }}
    >
      {props.children}
      {isOver && <p className="drophint">{props.words}</p>}
    </div>
  );
}
