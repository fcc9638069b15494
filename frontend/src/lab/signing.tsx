/** The password: typed again for an act that is signed, and changed by its owner. */

import { useState } from "react";
import { Link, Navigate, useNavigate } from "react-router";
import { useChangePassword, useConfirmPassword, useSignOut } from "@/api/commands";
import { useSession } from "@/api/queries";
import { useSigning } from "@/api/signing";
import type { User } from "@/model/wire";
import { Button, Dialog, Refused, TextField } from "@/ui/controls";
import { words } from "./words";

/** Asks for the password whenever an act has to be signed. */
export function SigningDialog({ user }: { user: User }) {
  const { answer, end } = useSigning();
  const isOpen = answer !== null;
  return (
    <Dialog isOpen={isOpen} title={words.signing.title} onClose={() => end(false)}>
      {isOpen && <SigningForm user={user} end={end} />}
    </Dialog>
  );
}

function SigningForm({ user, end }: { user: User; end: (isSigned: boolean) => void }) {
  const [password, setPassword] = useState("");
  const confirm = useConfirmPassword();
  return (
    <form
      className="sheet"
      data-testid="signing-form"
      onSubmit={(event) => {
        event.preventDefault();
        event.stopPropagation();
        confirm.mutate(password, { onSuccess: () => end(true) });
      }}
    >
      <p className="s">{words.signing.about(user.name)}</p>
      <input type="text" autoComplete="username" value={user.username} readOnly hidden />
      <TextField
        label={words.signing.password}
        type="password"
        value={password}
        onChange={setPassword}
        autoComplete="current-password"
        autoFocus
        testId="signing-password"
      />
      <Refused error={confirm.error} />
      <div className="acts">
        <Button onClick={() => end(false)} large>
          {words.signing.cancel}
        </Button>
        <Button
          type="submit"
          look="pri"
          large
          testId="signing-send"
          disabled={confirm.isPending}
          why={password ? null : words.signing.empty}
        >
          {words.signing.send}
        </Button>
      </div>
    </form>
  );
}

/** Where a person chooses a new password; nothing else works while somebody else knows theirs. */
export function PasswordPage() {
  const session = useSession();
  const navigate = useNavigate();
  const user = session.data?.user ?? null;
  const [old, setOld] = useState("");
  const [fresh, setFresh] = useState("");
  const [again, setAgain] = useState("");
  const change = useChangePassword();
  const signOut = useSignOut();
  if (session.data && !user) return <Navigate to="/login?next=/password" replace />;
  if (!user) return null;
  const isDue = user.password_from === "admin";
  const why = !old || !fresh ? words.password.empty : fresh === again ? null : words.password.other;
  return (
    <main className="login">
      <form
        className="card"
        data-testid="password-form"
        onSubmit={(event) => {
          event.preventDefault();
          change.mutate({ old, new: fresh }, { onSuccess: () => void navigate("/") });
        }}
      >
        <div className="login-head">
          <h1>{words.password.title}</h1>
        </div>
        <p className="s">{isDue ? words.password.due : words.password.about}</p>
        <input type="text" autoComplete="username" value={user.username} readOnly hidden />
        <Secret label={words.password.old} value={old} onChange={setOld} name="old" />
        <Secret label={words.password.fresh} value={fresh} onChange={setFresh} name="new" />
        <Secret label={words.password.again} value={again} onChange={setAgain} name="again" />
        <Refused error={change.error ?? signOut.error} />
        <div className="acts">
          {isDue ? (
            <SignOut act={signOut} />
          ) : (
            <Link className="btn lg" to="/">
              {words.password.cancel}
            </Link>
          )}
          <Button
            type="submit"
            look="pri"
            large
            testId="password-send"
            disabled={change.isPending}
            why={why}
          >
            {words.password.send}
          </Button>
        </div>
      </form>
    </main>
  );
}

/** One password of the form. */
function Secret(props: {
  label: string;
  name: "old" | "new" | "again";
  value: string;
  onChange: (value: string) => void;
}) {
  return (
    <TextField
      label={props.label}
      type="password"
      value={props.value}
      onChange={props.onChange}
      autoComplete={props.name === "old" ? "current-password" : "new-password"}
      testId={`password-${props.name}`}
    />
  );
}

function SignOut({ act }: { act: ReturnType<typeof useSignOut> }) {
  const navigate = useNavigate();
  return (
    <Button
      onClick={() => act.mutate(undefined, { onSuccess: () => void navigate("/login") })}
      large
      disabled={act.isPending}
      testId="password-sign-out"
    >
      {words.password.signOut}
    </Button>
  );
}
